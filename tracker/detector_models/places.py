"""What a fit says of one view that stands still: standing false boxes at their places, and bodies of which nothing is visible."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from tracker.detector_models.fit import LEAST_VISIBLE, fit
from tracker.detector_models.fitting import Source
from tracker.detector_models.model import LONGEST, MOST_SAMPLES, DetectorModel
from tracker.detector_models.observations import matched
from tracker.detector_models.samples import SITE_TIME, Samples, samples_of
from tracker.geometry import Array


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

    A place that had a box within SITE_TIME of the last frame goes on. Places end and begin as often as they did, and begin where one was.
    A stationary process has births × (time of the fit + life) places in the fit, with those that stood at its start.
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
