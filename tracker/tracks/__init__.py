"""Parts of the tracker of people beside its track trees: track state, sensor model of the views, re-identification, and track ids.

Read `tracks.py` first.
"""

from tracker.tracks.parameters import MhtParameters
from tracker.tracks.tracks import MotionParameters, Tracks

__all__ = ["MhtParameters", "MotionParameters", "Tracks"]
