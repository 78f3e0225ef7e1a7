"""Difficult input of the tracker of people: empty and crowded ticks, equal boxes, late and missing views, large ids, fast objects."""

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

ALL = pytest.mark.parametrize(
    "parameters",
    [Parameters(), Parameters(targets=MhtParameters(n_scan=0.0)), Parameters(targets=MhtParameters(k_h=3, i_bls_max=300))],
    ids=["one graph", "greedy", "small graphs"],
)


def scored(walked: Array, estimates: list[Estimate], shift: int = 0) -> TargetScore:
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
    assert scored(walked, list(track(setup, late, parameters))).mota > 0.8


@ALL
def test_a_view_that_is_missing_for_50_ticks_does_no_harm(parameters: Parameters) -> None:
    rng = np.random.default_rng(9)
    setup, walked = synthetic_crowd.setup(), synthetic_crowd.paths(4, 80, rng)
    thinned = [replace(t, views=t.views[1:]) if 15 <= t.index < 65 else t for t in synthetic_crowd.ticks(setup, walked, rng)]
    assert scored(walked, list(track(setup, thinned, parameters))).mota > 0.85


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
    assert scored(walked, a, shift=2**40) == scored(walked, a)


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
