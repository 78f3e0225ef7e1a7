"""Multi-robot EKF-SLAM from panoramas: features, data association, landmarks, relocalization, and robots that see each other.

Read `filter.py` first."""
