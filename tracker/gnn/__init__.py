"""The global nearest neighbour tracker of people: one assignment of boxes to tracks a tick, negative information, and fixed-lag smoothing.

Read `tracker.py` first.
"""

from tracker.gnn.tracker import GnnTracker

__all__ = ["GnnTracker"]
