"""Cameras calibrated by the people who walk before them, with deviations, and with what the data do not say. Read `calibrate.py` first."""

from tracker.calibration.calibrate import calibrate
from tracker.calibration.result import Calibration, Known

__all__ = ["Calibration", "Known", "calibrate"]
