"""Policies that place robots, their training and their comparison.

Read `policy.py` first."""
