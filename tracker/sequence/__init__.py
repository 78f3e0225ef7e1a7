"""pilsim's own recording folder: schema, calibration, truth tables, writer, reader, and the results of tracking.

Read `reader.py` first."""
