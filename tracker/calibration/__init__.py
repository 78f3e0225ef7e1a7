"""Calibration of cameras from boxes of walking people, with covariances and what the data leave undetermined. Read `calibrate.py` first."""

from tracker.calibration.calibrate import calibrate
from tracker.calibration.result import Calibration, Known

__all__ = ["Calibration", "Known", "calibrate"]
