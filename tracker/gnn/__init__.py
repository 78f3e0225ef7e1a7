"""The default tracker of people: one hypothesis, boxes assigned view by view (global nearest neighbour).

Read `tracker.py` first."""
