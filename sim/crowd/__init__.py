"""Many people: goals, behaviour, social force, steering, and replayed paths.

Read `crowd.py` first."""
