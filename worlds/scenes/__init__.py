"""The worlds, one a file, each with its ground plan beside it.

Read `pilsun.py` first."""
