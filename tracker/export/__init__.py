"""A recorded sequence in the formats of other projects.

Read `exporting.py` first.
"""
