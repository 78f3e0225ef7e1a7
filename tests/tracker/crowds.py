"""The crowds of tracker/datasets/synthetic_crowd.py, by the name that the tests have for them."""

from tracker.datasets.synthetic_crowd import CORNERS, EYE, RATE, boxes, hills, paths, setup, ticks

__all__ = ["CORNERS", "EYE", "RATE", "boxes", "hills", "paths", "setup", "ticks"]
