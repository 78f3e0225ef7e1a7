"""EKF-SLAM in the plane for UTIAS data (MRCLAM): range and bearing, velocity commands, trajectories and their scores.

Read `filter.py` first."""
