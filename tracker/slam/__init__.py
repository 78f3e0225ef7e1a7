"""Multi-robot EKF-SLAM from panoramas: features, data association, landmark initialization, relocalization and inter-robot measurements.

Read `filter.py` first.
"""
