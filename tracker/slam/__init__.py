"""Multi-robot EKF-SLAM from panoramas: features, data association, landmark initialization, relocalization and inter-robot measurements.

Read `filter.py` first.
"""

from tracker.slam.filter import Slam
from tracker.slam.parameters import SlamParameters

__all__ = ["Slam", "SlamParameters"]
