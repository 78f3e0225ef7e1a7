"""The multiple-hypothesis tracker: track trees, and the best set of tracks as a maximum-weight clique.

Read `tracker.py` first."""
