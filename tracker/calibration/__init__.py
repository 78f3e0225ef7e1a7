"""Cameras calibrated by the people who walk before them, with what is not known said. Read `calibrate.py` first."""
