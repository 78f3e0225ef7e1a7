"""Fit of a detector's error model to the folders of recordings, and the comparison of its boxes with the real ones."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

from tracker.detector_models.comparison import distances
from tracker.detector_models.fit import fit
from tracker.detector_models.independent import IndependentErrors
from tracker.detector_models.model import DetectorModel
from tracker.detector_models.observations import TruePeople, observed, true_people
from tracker.detector_models.samples import Samples, joined, samples_of
from tracker.detector_models.shared_errors import agreed
from tracker.detector_models.simulation import Simulated, simulated_detections
from tracker.formats.opening import open_recording
from tracker.formats.source_options import SourceOptions
from tracker.io.resume import checksum
from tracker.recordings import Recording

SEED = 1
"""Of the simulated boxes that are compared with the real ones."""


@dataclass(frozen=True, eq=False)
class Source:
    """A recording with its true people. description: what of it was read, as JSON values."""

    recording: Recording
    truth: TruePeople
    description: dict[str, Any]

    def samples(self, detections: Simulated | None = None, near: float = 0.0) -> Samples:
        """The samples of its own boxes, or of `detections`. near: as in observations.match_frame."""
        return samples_of(self.recording, observed(self.recording, self.truth, detections, near), bool(self.truth.boxes))


@dataclass(frozen=True, eq=False)
class Fit:
    """A model, what it was fitted to, what it simulates on the same people, and the distances: detector → statistic → distance from real boxes."""

    model: DetectorModel
    real: Samples
    simulated: Samples
    distances: dict[str, dict[str, float]]


def open_source(path: Path, options: SourceOptions) -> Source:
    """Open a recording for a fit. Raises ValueError, with the path, where it has no detector's boxes, no truth, or where options do not fit it."""
    recording = open_recording(path, options)
    if not recording.detections:
        raise ValueError(f"{path}: has no detections, which a fit needs (--detections)")
    description = {"folder": path.resolve().name, "cameras": list(recording.detections), "frames": [0, recording.frames], **recording.source}
    truth = true_people(path, recording)
    if truth.file:
        description["truth"] = {Path(truth.file).name: checksum(Path(truth.file))}
    return Source(recording, truth, description)


def places_note(model: DetectorModel) -> str:
    """What true boxes are where truth has places only."""
    text = "Truth has places only: true boxes are projected bodies of 1.75 x 0.5 m."
    if all("truth_errors" in source for source in model.made["sources"]):
        return f"{text} Views agree on other places and statures; errors are those from these."
    return f"{text} The spread of stature is a part of the errors of edges."


def agreed_source(source: Source) -> Source:
    """The source with the people that all views see, where these are known: annotations are off, which is no error of the detector."""
    truth, errors = agreed(source.recording, source.truth)
    return source if errors is None else replace(source, truth=truth, description=source.description | {"truth_errors": errors.to_dict()})


def fit_sources(sources: Sequence[Source], name: str) -> Fit:
    """Fit a model to sources together, and compare it. Raises ValueError where there is too little truth, or where sources do not go together."""
    kinds = {source.truth.kind for source in sources}
    if len(kinds) > 1:
        raise ValueError("one source has true boxes and one has true places alone, needs sources of one kind")
    sources = [agreed_source(source) for source in sources]
    real = joined([source.samples() for source in sources])
    made = {"pilsim": version("pilsim"), "sources": [source.description for source in sources]}
    model = fit(real, name, kinds.pop(), made)
    own = joined([s.samples(simulated_detections(s.recording, s.truth, model, SEED)) for s in sources])
    plain = joined([s.samples(simulated_detections(s.recording, s.truth, IndependentErrors(), SEED)) for s in sources])
    filled = (model.edges.hidden, model.edges.border)
    return Fit(model, real, own, {"this model": distances(real, own, filled), "independent": distances(real, plain, filled)})
