"""Twins of a recording without rendering: its true people before the models of its cameras, seen by models of detectors."""

from __future__ import annotations

from dataclasses import replace

from sim.prediction.halves import FittedViews
from tracker.detector_models.fitting import Source
from tracker.detector_models.shared_errors import drawn
from tracker.detector_models.simulation import independent_detections, simulated_detections
from tracker.recordings import Recording

Models = FittedViews | None
"""None for the detector with independent errors."""


def twin(source: Source, models: Models, seed: int) -> Recording:
    """The recording with simulated boxes in place of its own. The same seed gives the same boxes.

    People walk their true paths, moved by the errors of the truth that all views share.
    Their bodies are the true boxes where these are known, and cylinders of one size elsewhere.
    They hide each other, and pillars hide them.
    """
    recording = source.recording
    names = list(recording.detections) or list(recording.cameras)
    if models is None:
        detections = independent_detections(recording, source.truth, seed, names)
    else:
        truth = source.truth if models.shared is None else drawn(recording, source.truth, models.shared, seed)
        detections = simulated_detections(recording, truth, models.models, seed, names)
    return replace(recording, detections=detections)
