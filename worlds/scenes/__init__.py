"""The worlds, one per file, each with its ground plan.

Read `pilsun.py` first."""
