"""Learned confidences: the tracker gives the same answer for any monotone transform of all confidences, and works with one number for all."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from tests.conftest import DATA
from tracker.datasets import synthetic_crowd
from tracker.formats.opening import open_sequence
from tracker.formats.source_options import SourceOptions
from tracker.geometry import Array
from tracker.metrics.clear_mot import score
from tracker.metrics.matching import MatchingFrame
from tracker.options import parameters_from
from tracker.pipeline import track
from tracker.types import Detections, Estimate, Setup, Tick

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
