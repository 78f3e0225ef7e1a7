"""EKF-SLAM of a team in the plane for UTIAS data (MRCLAM): range and bearing measurements, velocity commands, trajectories and their scores.

Read `filter.py` first.
"""

from tracker.planar_slam.event_schedule import PlanarParameters
from tracker.planar_slam.utias_run import evaluate_trajectories, track_utias

__all__ = ["PlanarParameters", "evaluate_trajectories", "track_utias"]
