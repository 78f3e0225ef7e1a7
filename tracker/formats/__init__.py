"""File formats of other projects, one per module, with reader and writer side by side.

Read `motchallenge.py` first.
"""
