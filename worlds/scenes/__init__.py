"""The worlds, one a file, each with its ground plan.

Read `pilsun.py` first."""
