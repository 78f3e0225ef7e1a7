"""Multi-robot SLAM, multi-view tracking of people, and their scores. The package never imports MuJoCo.

Read `pipeline.py` first: the whole tracker in a hundred lines.
"""
