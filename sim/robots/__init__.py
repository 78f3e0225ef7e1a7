"""The rover: body, driver and dead reckoning.

Read `rover.py` first."""
