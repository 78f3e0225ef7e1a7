"""Data sets on disk: opening them, degrading their detections, validating, summarizing and describing them.

Read `opening.py` first.
"""
