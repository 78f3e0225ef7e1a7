"""Learned confidences: the tracker gives the same answer for any monotone transform of all confidences, and works with one number for all."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.conftest import DATA
from tracker.datasets import synthetic_crowd
from tracker.formats.opening import open_sequence
from tracker.formats.source_options import SourceOptions
from tracker.geometry import Array, angles_from_bearing
from tracker.metrics.clear_mot import score
from tracker.metrics.evaluation import evaluate
from tracker.metrics.matching import MatchingFrame
from tracker.options import parameters_from
from tracker.pipeline import Parameters, track
from tracker.sequence.results import Results
from tracker.types import Detections, Estimate, Setup, Tick, TicksInMemory

LEARNED = parameters_from({"confidence": "learned", "delay": 3})

TRANSFORMS: dict[str, Callable[[Array], Array]] = {
    "square": lambda c: c**2,
    "root": np.sqrt,
    "affine": lambda c: 0.3 + 0.7 * c,
    "log": lambda c: -np.log(1.0001 - c),
}


def transformed(ticks: list[Tick], function: Callable[[Array], Array]) -> list[Tick]:
    return [
        replace(t, views=tuple(replace(v, detections=replace(v.detections, confidence=function(v.detections.confidence))) for v in t.views))
        for t in ticks
    ]


def tracked(setup: Setup, ticks: list[Tick]) -> list[Estimate]:
    return list(track(setup, ticks, LEARNED))


def check_same(a: list[Estimate], b: list[Estimate]) -> None:
    assert sum(len(e.target_id) for e in a) > 0
    for one, other in zip(a, b, strict=True):
        np.testing.assert_array_equal(one.target_id, other.target_id)
        np.testing.assert_array_equal(one.position, other.position)


def test_a_crowd_is_tracked_alike_on_any_scale() -> None:
    rng = np.random.default_rng(7)
    setup, walked = synthetic_crowd.setup(), synthetic_crowd.paths(8, 30, rng)
    ticks = synthetic_crowd.ticks(setup, walked, rng, clutter=0.5)
    plain = tracked(setup, ticks)
    for function in TRANSFORMS.values():
        check_same(plain, tracked(setup, transformed(ticks, function)))


def test_a_crowd_is_tracked_with_one_number_for_all_confidences() -> None:
    rng = np.random.default_rng(7)
    setup, walked = synthetic_crowd.setup(), synthetic_crowd.paths(8, 60, rng)
    ticks, ids, found = synthetic_crowd.ticks(setup, walked, rng), np.arange(8), []
    for each in (ticks, transformed(ticks, lambda c: np.full(len(c), -1.0))):
        frames = [MatchingFrame(ids, places, e.target_id, e.position) for places, e in zip(walked, tracked(setup, each), strict=True)]
        found.append(score(frames).mota)
    assert found[1] > max(found[0] - 0.03, 0.9)


def test_people_keep_their_tracks_whose_boxes_become_like_false_ones() -> None:
    rng = np.random.default_rng(7)
    setup, walked = synthetic_crowd.setup(), np.repeat(np.array([[-2.0, -2.0], [2.0, 1.0], [0.0, 3.0]])[None], 90, axis=0)
    false = transformed(synthetic_crowd.ticks(setup, walked[:40, :0], rng, misses=0.0, clutter=2.0), lambda c: np.full(len(c), 0.5))
    true = synthetic_crowd.ticks(setup, walked, rng, misses=0.05, clutter=0.0)
    before, after = (transformed(part, lambda c, at=at: np.full(len(c), at)) for part, at in ((true[:40], 0.9), (true[40:], 0.5)))
    names = ("bearing", "extent", "confidence", "covariance", "appearance")
    both = [
        replace(a, views=tuple(
            replace(v, detections=Detections(*(np.concatenate([getattr(x.detections, name) for x in (v, w)]) for name in names)))
            for v, w in zip(a.views, b.views, strict=True)
        ))
        for a, b in zip(before, false, strict=True)
    ]  # fmt: skip
    found = tracked(setup, [*both, *after])
    ids = set(found[35].target_id.tolist())
    assert len(ids) == 3
    assert all(set(e.target_id.tolist()) == ids for e in found[60:])


@pytest.mark.data
@pytest.mark.parametrize(("source", "cameras"), [("cmc/CMC2", ()), ("pets2009/S2.L1", ("1", "5", "7"))])
def test_recordings_are_tracked_alike_on_any_scale(source: str, cameras: tuple[str, ...]) -> None:
    sequence = open_sequence(DATA / source, SourceOptions(cameras=cameras, frames=(0, 60)))
    ticks = list(sequence.ticks)
    check_same(tracked(sequence.setup, ticks), tracked(sequence.setup, transformed(ticks, TRANSFORMS["log"])))


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
