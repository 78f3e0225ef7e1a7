"""The multiple-hypothesis tracker: track trees, and the global hypothesis as a maximum-weight clique.

Read `tracker.py` first."""

from tracker.mht.tracker import MhtTracker

__all__ = ["MhtTracker"]
