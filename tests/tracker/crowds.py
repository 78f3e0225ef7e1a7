"""The crowds of tracker/crowds.py, by the name that the tests have for them."""

from tracker.crowds import CORNERS, EYE, RATE, boxes, hills, paths, setup, ticks

__all__ = ["CORNERS", "EYE", "RATE", "boxes", "hills", "paths", "setup", "ticks"]
