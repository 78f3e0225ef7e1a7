"""Finding people in the pixels of a camera by a neural network, as boxes of whole bodies with calibrated scores.

Read `detector.py` first.
"""

from tracker.person_detector.detector import PersonDetector
from tracker.person_detector.found_boxes import FoundBoxes
from tracker.person_detector.network import PersonNetwork

__all__ = ["FoundBoxes", "PersonDetector", "PersonNetwork"]
