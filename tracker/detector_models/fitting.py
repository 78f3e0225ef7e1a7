"""Fit of a detector's error model to the folders of recordings, the comparison of its boxes with the real ones, and models of single views."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from tracker.detector_models.bodies import LEAST_VISIBLE
from tracker.detector_models.comparison import distances
from tracker.detector_models.fit import fit
from tracker.detector_models.independent import IndependentErrors
from tracker.detector_models.model import DetectorModel
from tracker.detector_models.observations import TruePeople, matched, observed, true_people
from tracker.detector_models.samples import SITE_TIME, Samples, joined, samples_of
from tracker.detector_models.schema import LONGEST, MOST_SAMPLES
from tracker.detector_models.shared_errors import agreed
from tracker.detector_models.simulation import Simulated, simulated_detections
from tracker.formats.opening import open_recording
from tracker.formats.source_options import SourceOptions
from tracker.geometry import Array
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

    def samples(self, detections: Simulated | None = None) -> Samples:
        """The samples of its own boxes, or of `detections`."""
        return samples_of(self.recording, observed(self.recording, self.truth, detections), bool(self.truth.boxes))


@dataclass(frozen=True, eq=False)
class Fit:
    """A model, what it was fitted to, what it simulates on the same people, and the distances: detector → statistic → distance from real boxes."""

    model: DetectorModel
    real: Samples
    simulated: Samples
    distances: dict[str, dict[str, float]]


def open_source(path: Path, options: SourceOptions) -> Source:
    """Open a recording for a fit. Raises ValueError, with the path, where it has no detector's boxes, no truth, or where options do not fit it."""
    recording = open_recording(path, options).in_step()
    if not recording.detections:
        raise ValueError(f"{path}: has no detections, which a fit needs (--detections)")
    description = {"folder": path.resolve().name, "cameras": list(recording.detections), "frames": [0, recording.frames], **recording.source}
    truth = true_people(path, recording)
    if truth.file:
        description["truth"] = {Path(truth.file).name: checksum(Path(truth.file))}
    return Source(recording, truth, description)


def places_note(model: DetectorModel) -> str:
    """A sentence on true boxes for a model whose truth has places only."""
    text = "Truth has places only: true boxes are projected bodies of 1.75 x 0.5 m."
    if all("truth_errors" in source for source in model.made["sources"]):
        return f"{text} Views agree on other places and statures; errors are those from these."
    return f"{text} The spread of stature is a part of the errors of edges."


def agreed_source(source: Source) -> Source:
    """The source with the places and statures on which all views agree, if known: errors of annotations are not the detector's."""
    truth, errors = agreed(source.recording, source.truth)
    return source if errors is None else replace(source, truth=truth, description=source.description | {"truth_errors": errors.to_dict()})


def fit_sources(sources: Sequence[Source], name: str) -> Fit:
    """Fit a model to sources together, and compare it. Raises ValueError for too little truth, and for different kinds of truth or rates."""
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


def fit_view(source: Source, name: str, made: Mapping[str, Any]) -> DetectorModel:
    """The model of a view for use in that view alone, without intervals.

    Its edges have a trend, and standing false boxes are at fixed places.

    source: with the detections of one view. Raises ValueError where there is too little truth.
    """
    frames, near = matched(source.recording, source.truth)
    samples = samples_of(source.recording, frames, bool(source.truth.boxes))
    model = fit(samples, name, source.truth.kind, made, replicates=0, view_alone=True)
    return at_its_places(replace(model, misses=replace(model.misses, unseen=unseen(samples)), edges=replace(model.edges, near=near)), samples)


def unseen(samples: Samples) -> float:
    """Share of misses of bodies of which nothing is visible, with Laplace's rule."""
    people = samples.people
    none = people.visible <= LEAST_VISIBLE
    return round(float(((~people.detected & ~people.merged & none).sum() + 1) / ((none & ~people.merged).sum() + 1)), 4)


def at_its_places(model: DetectorModel, samples: Samples) -> DetectorModel:
    """The model with the standing false boxes of the first view of the samples at their places in the image.

    A place with a box within SITE_TIME of the last frame still exists at the end. Places end and begin at the rates of the fit, where one was.
    A stationary process has births × (duration of the fit + life) places during the fit, with those from its start.
    """
    false = samples.false
    mine = false.view == 0
    total = int(false.frames[0])
    rows, lives, ends = list[Array](), 0, 0
    margin = max(1, round(SITE_TIME / samples.period))
    for site in np.unique(false.site[mine & (false.site >= 0)]).tolist():
        at = mine & (false.site == site)
        frames = np.unique(false.frame[at])
        span, stands = int(frames[-1] - frames[0] + 1), frames[-1] >= total - margin
        sure = np.percentile(false.confidence[at], [10, 90])
        rows.append(np.array([*np.median(false.edges[at], axis=0), len(frames) / span, *sure, float(stands)]))
        lives, ends = lives + span, ends + (not stands)
    fixed = tuple(tuple(row) for row in np.round(np.array(rows).reshape(-1, 8), 4).tolist())[:MOST_SAMPLES]
    life = lives * samples.period / ends if ends else LONGEST
    rate = len(rows) / (samples.period * total + min(life, LONGEST))
    standing = replace(model.standing, fixed=fixed, life_s=round(min(life, LONGEST), 4), births=round(rate, 5) if fixed else 0.0)
    return replace(model, standing=standing if fixed else replace(standing, sites=0.0))
