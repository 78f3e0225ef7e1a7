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
from tracker.types import Detections, Estimate, Setup, Tick, View


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


ALL = pytest.mark.parametrize(
    "parameters",
    [Parameters(), Parameters(targets=MhtParameters(n_scan=0.0)), Parameters(targets=MhtParameters(k_h=3, i_bls_max=300))],
    ids=["one graph", "greedy", "small graphs"],
)


def score_of(walked: Array, estimates: list[Estimate], shift: int = 0) -> TargetScore:
    people = np.arange(walked.shape[1]) + shift
    return score([MatchingFrame(people, places, e.target_id + shift, e.position) for places, e in zip(walked, estimates, strict=True)])


def boxes_of_people(setup: Setup, places: Array) -> Detections:
    """Boxes of people at places (n, 2) m in the first camera, without errors."""
    start, n = setup.starts["robot_0"], len(places)
    assert start is not None
    middle, extent = synthetic_crowd.boxes(start.T_world_robot, np.column_stack([places, np.zeros(n)]))
    return Detections(middle, extent, np.ones(n), np.tile(1e-5 * np.eye(2), (n, 1, 1)), np.zeros((n, 0)))


@ALL
@pytest.mark.parametrize("boxes", [0, 200])
def test_empty_and_crowded_ticks_pass(parameters: Parameters, boxes: int) -> None:
    setup = synthetic_crowd.setup()
    found = boxes_of_people(setup, np.random.default_rng(8).uniform(-4, 4, (boxes, 2))) if boxes else Detections.none()
    for estimate in track(setup, [Tick(k, k / 6, tuple(View(name, found) for name in setup.mounts)) for k in range(3)], parameters):
        assert np.isfinite(estimate.position).all()
        assert bool(boxes) or not len(estimate.target_id)


@ALL
def test_an_empty_tick_and_one_without_views_lose_nobody(parameters: Parameters) -> None:
    rng = np.random.default_rng(2)
    setup, walked = synthetic_crowd.setup(), synthetic_crowd.paths(3, 30, rng)
    ticks = synthetic_crowd.ticks(setup, walked, rng, misses=0.0, clutter=0.0)
    ticks[15] = replace(ticks[15], views=tuple(replace(v, detections=Detections.none()) for v in ticks[15].views))
    ticks[20] = replace(ticks[20], views=())
    estimates = list(track(setup, ticks, parameters))
    before, after = ({*e.target_id.tolist()} for e in (estimates[14], estimates[24]))
    assert before == after
    assert len(after) == 3


@ALL
def test_tracks_of_equal_boxes_stay_in_place(parameters: Parameters) -> None:
    setup = synthetic_crowd.setup()
    found = boxes_of_people(setup, np.zeros((6, 2)))
    last = list(track(setup, [Tick(k, k / 6, (View("camera_0", found),)) for k in range(8)], parameters))[-1]
    assert 1 <= len(last.target_id) <= 6
    np.testing.assert_allclose(last.position[:, :2], 0, atol=0.2)


@ALL
def test_a_view_that_is_one_tick_late_does_little_harm(parameters: Parameters) -> None:
    rng = np.random.default_rng(11)
    setup, walked = synthetic_crowd.setup(), synthetic_crowd.paths(4, 50, rng)
    ticks = synthetic_crowd.ticks(setup, walked, rng)
    late = [replace(t, views=(ticks[max(k - 1, 0)].views[0], *t.views[1:])) for k, t in enumerate(ticks)]
    assert score_of(walked, list(track(setup, late, parameters))).mota > 0.8


@ALL
def test_a_view_that_is_missing_for_50_ticks_does_no_harm(parameters: Parameters) -> None:
    rng = np.random.default_rng(9)
    setup, walked = synthetic_crowd.setup(), synthetic_crowd.paths(4, 80, rng)
    thinned = [replace(t, views=t.views[1:]) if 15 <= t.index < 65 else t for t in synthetic_crowd.ticks(setup, walked, rng)]
    assert score_of(walked, list(track(setup, thinned, parameters))).mota > 0.85


def test_track_ids_beyond_32_bits_change_nothing() -> None:
    rng = np.random.default_rng(12)
    setup, walked = synthetic_crowd.setup(), synthetic_crowd.paths(4, 25, rng)
    ticks = synthetic_crowd.ticks(setup, walked, rng)
    plain, far = Tracker(setup, Parameters()), Tracker(setup, Parameters())
    far._people.filter._next_tree = 2**40
    a, b = ([e for t in ticks if (e := tracker.step(t))] for tracker in (plain, far))
    for one, other in zip(a, b, strict=True):
        np.testing.assert_array_equal(one.target_id, other.target_id)
        np.testing.assert_array_equal(one.position, other.position)
    assert score_of(walked, a, shift=2**40) == score_of(walked, a)


@pytest.mark.parametrize("index", [3, 2])
def test_ticks_out_of_order_and_unknown_views_are_refused(index: int) -> None:
    tracker = Tracker(synthetic_crowd.setup(), Parameters())
    tracker.step(Tick(3, 0.5, ()))
    with pytest.raises(ValueError, match=f"tick {index} comes after tick 3"):
        tracker.step(Tick(index, 0.5, ()))
    with pytest.raises(ValueError, match="camera 'nose'"):
        tracker.step(Tick(4, 0.6, (View("nose", Detections.none()),)))


@pytest.mark.parametrize(("speed", "tracked"), [(2.0, True), (6.0, False)])
def test_objects_faster_than_people_are_not_tracked(speed: float, tracked: bool) -> None:
    """A box on a straight line: a runner is a person, an object as fast as a car is not."""
    setup = synthetic_crowd.setup()
    ticks = []
    for k in range(8):
        place = np.array([[speed * (k * setup.period - 0.6), 1.0]])
        ticks.append(Tick(k, k * setup.period, (View("camera_0", boxes_of_people(setup, place)),)))
    last = list(track(setup, ticks))[-1]
    near = np.linalg.norm(last.position[:, :2] - place, axis=1) < 0.5 if len(last.target_id) else np.zeros(0, dtype=bool)
    assert near.any() == tracked
