"""People of PETS 2009 S2.L1, frames 0 to 399, and what confidences of boxes mean for tracks.

Detections are given, poor, halved, or with false boxes (the mean of three seeds). People are reported 10 frames late.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tracker.datasets import synthetic_crowd
from tracker.formats.opening import open_sequence
from tracker.formats.source_options import SourceOptions
from tracker.geometry import Array, angles_from_bearing
from tracker.metrics.evaluation import evaluate
from tracker.pipeline import Parameters, track
from tracker.sequence.results import Results
from tracker.types import Detections, Estimate, Setup, Tick, TicksInMemory

FRAMES = 400


@pytest.mark.soak
@pytest.mark.parametrize(
    ("views", "poor", "degrade", "mota", "idf1"),
    [
        ([1, 5, 7], False, "", 0.98, 0.99),
        ([1, 5, 7], True, "", 0.955, 0.96),
        ([1], True, "drop=0.02", 0.84, 0.8),
        ([1, 5, 7], False, "drop=0.5", 0.96, 0.92),
        ([1, 5, 7], False, "drop=0.3,clutter=2", 0.975, 0.9),
    ],
)
def test_people_keep_their_ids_on_pets(data: Callable[..., Path], views: list[int], poor: bool, degrade: str, mota: float, idf1: float) -> None:
    folder = data("pets2009", "S2.L1")
    other = [f"{views[0]}={folder / 'mot15' / 'det.txt'}"] if poor else []
    found = []
    for seed in range(3 if degrade else 1):
        sequence = open_sequence(folder, SourceOptions.parse(other, degrade, seed, ",".join(map(str, views))))
        assert sequence.truth is not None
        ticks = TicksInMemory(tuple(itertools.islice(iter(sequence.ticks), FRAMES)), sequence.setup.mounts)
        half = replace(sequence, ticks=ticks, truth=sequence.truth[:FRAMES])
        found.append(evaluate(half, Results.of(track(half.setup, half.ticks, Parameters(delay=10)), {}))["targets"])
    assert np.mean([f["mota"] for f in found]) >= mota
    assert np.mean([f["idf1"] for f in found]) >= idf1


def standing(people: list[tuple[float, float]], count: int, rng: np.random.Generator) -> tuple[Setup, list[Tick]]:
    """One camera, and people who stand still."""
    setup = synthetic_crowd.setup(1)
    return setup, list(synthetic_crowd.ticks(setup, np.repeat(np.array([people]), count, axis=0), rng, misses=0.0, clutter=0.0))


def with_confidence(tick: Tick, confidence: float) -> Tick:
    """The tick with boxes of that confidence."""
    views = (replace(v, detections=replace(v.detections, confidence=np.full(len(v.detections), confidence))) for v in tick.views)
    return replace(tick, views=tuple(views))


def test_one_number_for_all_boxes_says_nothing() -> None:
    """Whether it is high, low, or −1 for unknown: the boxes themselves tell."""
    setup, ticks = standing([(-2.0, -2.0)], 20, np.random.default_rng(1))
    first, *others = ([e.position.tolist() for e in track(setup, [with_confidence(tick, one) for tick in ticks])] for one in (0.9, 0.2, -1.0))
    assert len(first[-1]) == 1
    assert all(other == first for other in others)


PEOPLE = np.array([[-2.0, -2.0], [2.0, 1.0], [0.0, 3.0], [3.0, -3.0]])


def among_false_boxes(count: int, rng: np.random.Generator) -> tuple[Setup, list[Tick]]:
    """Three cameras that see PEOPLE standing still, and one false box a view and tick on average; these have lower confidences."""
    setup, walked = synthetic_crowd.setup(), np.repeat(PEOPLE[None], count, axis=0)
    false = synthetic_crowd.ticks(setup, walked[:, :0], rng, misses=0.0, clutter=1.0)
    true = synthetic_crowd.ticks(setup, walked, rng, misses=0.1, clutter=0.0)
    out = []
    for a, b in zip(false, true, strict=True):
        views = zip(with_confidences(a, (0.1, 0.5), rng).views, with_confidences(b, (0.4, 0.9), rng).views, strict=True)
        out.append(replace(a, views=tuple(replace(v, detections=joined([v.detections, w.detections])) for v, w in views)))
    return setup, out


def with_confidences(tick: Tick, bounds: tuple[float, float], rng: np.random.Generator) -> Tick:
    """The tick with uniform confidences of all boxes."""
    boxes = ((v, v.detections) for v in tick.views)
    return replace(tick, views=tuple(replace(v, detections=replace(d, confidence=rng.uniform(*bounds, len(d)))) for v, d in boxes))


def joined(boxes: list[Detections]) -> Detections:
    """All boxes of one view."""
    names = ("bearing", "extent", "confidence", "covariance", "appearance")
    return Detections(*(np.concatenate([getattr(d, name) for d in boxes]) for name in names))


def reported(estimate: Estimate, place: Array) -> bool:
    """Whether somebody is reported within 0.5 m of a place (2,) m."""
    return bool((np.linalg.norm(estimate.position[:, :2] - place, axis=1) < 0.5).any())


def test_false_boxes_of_low_confidence_make_no_tracks_and_cost_nobody_theirs() -> None:
    setup, ticks = among_false_boxes(60, np.random.default_rng(1))
    estimates = list(track(setup, ticks))[20:]
    assert all(reported(e, place) for e in estimates for place in PEOPLE)
    assert np.mean([len(e.target_id) for e in estimates]) < len(PEOPLE) + 0.1


@pytest.mark.parametrize("seed", [0, 2, 3, 4])
def test_an_unconfident_box_keeps_a_track_from_the_box_of_another(seed: int) -> None:
    # One person behind the other, far away: the track without a box would be assigned the other's.
    x, y, yaw = synthetic_crowd.CAMERA_POSES[0]
    ahead, eye = np.array([np.cos(yaw), np.sin(yaw)]), np.array([x, y])
    setup, ticks = standing([tuple(eye + distance * ahead) for distance in (10.0, 10.4)], 45, np.random.default_rng(seed))

    def one_unconfident(tick: Tick) -> Tick:
        (view,) = tick.views
        nearer = np.argmin(angles_from_bearing(view.detections.bearing)[1] - view.detections.extent[:, 1] / 2)
        confidence = np.where(np.arange(len(view.detections)) == nearer, 0.7, 0.99)
        return replace(tick, views=(replace(view, detections=replace(view.detections, confidence=confidence)),))

    reported = list(track(setup, [one_unconfident(tick) if 20 <= k < 26 else tick for k, tick in enumerate(ticks)]))
    before, after = (dict(zip(e.target_id.tolist(), e.position[:, :2], strict=True)) for e in (reported[19], reported[-1]))
    assert len(before) == 2
    assert sorted(before) == sorted(after)
    assert all(np.linalg.norm(before[name] - after[name]) < 0.4 for name in before)
