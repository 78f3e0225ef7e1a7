"""From truth to measurements: boxes of people, other robots, key points and exposure, by rendered instances or by rays.

Read `person_detector.py` first."""
