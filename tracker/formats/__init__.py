"""Foreign file formats, one a file, with reader and writer side by side.

Read `motchallenge.py` first."""
