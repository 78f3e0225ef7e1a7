"""Whole data sets: opening them, degrading their detections, validating and summarizing them.

Read `opening.py` first."""
