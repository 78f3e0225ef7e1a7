"""The whole tracker on a synthetic crowd among fixed cameras."""

import time
from dataclasses import replace

import numpy as np
import pytest

from tracker.datasets import synthetic_crowd
from tracker.geometry import Array
from tracker.metrics.clear_mot import TargetScore, score
from tracker.metrics.matching import MatchingFrame
from tracker.pipeline import Parameters, Tracker, track
from tracker.tracks.parameters import MhtParameters
from tracker.types import Detections, Setup, Tick


def scored(setup: Setup, walked: Array, ticks: list[Tick]) -> TargetScore:
    estimates = list(track(setup, ticks))
    people = np.arange(walked.shape[1])
    return score([MatchingFrame(people, places, e.target_id, e.position) for places, e in zip(walked, estimates, strict=True)])


def test_one_view_is_enough_without_occlusion() -> None:
    rng = np.random.default_rng(5)
    setup, walked = synthetic_crowd.setup(views=1), synthetic_crowd.paths(4, 60, rng)
    assert scored(setup, walked, synthetic_crowd.ticks(setup, walked, rng, misses=0.05)).mota > 0.85


def test_order_of_detections_does_not_matter() -> None:
    rng = np.random.default_rng(2)
    setup, walked = synthetic_crowd.setup(), synthetic_crowd.paths(5, 25, rng)
    ticks = synthetic_crowd.ticks(setup, walked, rng)

    def shuffled(tick: Tick) -> Tick:
        views = []
        for view in tick.views:
            d, order = view.detections, rng.permutation(len(view.detections))
            values = (d.bearing[order], d.extent[order], d.confidence[order], d.covariance[order], d.appearance[order])
            views.append(replace(view, detections=Detections(*values)))
        return replace(tick, views=tuple(views))

    for a, b in zip(track(setup, ticks), track(setup, [shuffled(t) for t in ticks]), strict=True):
        np.testing.assert_array_equal(a.target_id, b.target_id)
        np.testing.assert_allclose(a.position, b.position, atol=1e-9)


def test_a_person_who_leaves_the_area_and_returns_has_a_new_id() -> None:
    rng = np.random.default_rng(6)
    x = np.concatenate([np.linspace(0, 4, 30), np.linspace(4, 0, 30)])
    walked = np.stack([x, np.zeros(60)], axis=1)[:, None, :]
    setup = synthetic_crowd.setup(area=np.array([[-10.0, -10.0], [2.5, 10.0]]))
    estimates = list(track(setup, synthetic_crowd.ticks(setup, walked, rng, misses=0, clutter=0)))
    assert {int(i) for e in estimates[:19] for i in e.target_id} == {1}
    assert all(len(e.target_id) == 0 for e in estimates[22:38])
    assert {int(i) for e in estimates[42:] for i in e.target_id} == {2}


@pytest.mark.parametrize(("wait", "same"), [(0, True), (30, False)])
def test_a_person_just_outside_the_area_for_a_moment_keeps_the_id(wait: int, same: bool) -> None:
    rng = np.random.default_rng(6)
    x = np.concatenate([np.linspace(0, 2.8, 20), np.full(wait, 2.8), np.linspace(2.8, 0, 20)])
    setup = synthetic_crowd.setup(area=np.array([[-10.0, -10.0], [2.3, 10.0]]))
    estimates = list(track(setup, synthetic_crowd.ticks(setup, np.stack([x, 0 * x], axis=1)[:, None, :], rng, misses=0, clutter=0)))
    assert len(estimates[20].target_id) == 0
    assert {int(i) for e in estimates for i in e.target_id} == ({1} if same else {1, 2})


@pytest.mark.soak
def test_memory_and_time_are_bounded_in_heavy_clutter() -> None:
    rng = np.random.default_rng(10)
    setup = synthetic_crowd.setup()
    tracker = Tracker(setup, Parameters())
    spent, held = [], []
    for tick in synthetic_crowd.ticks(setup, np.zeros((120, 0, 2)), rng, clutter=300):
        began = time.process_time()
        tracker.step(tick)
        spent.append(time.process_time() - began)
        held.append(len(tracker._people.filter.leaves))
    # Clutter makes a few dozen tentative leaves at most, however many boxes there are.
    assert max(held) <= MhtParameters().max_leaves
    assert max(held[80:]) <= 1.5 * max(held[20:60]) + 30
    assert np.median(spent[80:]) < 2 * np.median(spent[20:60])
