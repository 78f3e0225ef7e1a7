"""Error models of detectors of people: fitted to the boxes and the truth of a recording, kept as JSON, and simulated.

Read `model.py` first."""

from tracker.detector_models.model import DetectorModel

__all__ = ["DetectorModel"]
