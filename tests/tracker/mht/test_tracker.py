"""The multiple-hypothesis tracker: accuracy, gaps, occlusion, learning of detection rates, and bounds of time and memory."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tracker.datasets import synthetic_crowd
from tracker.formats.opening import open_sequence
from tracker.formats.source_options import SourceOptions
from tracker.geometry import Array
from tracker.metrics.clear_mot import TargetScore, score
from tracker.metrics.matching import MatchingFrame
from tracker.pipeline import Parameters, Tracker, track
from tracker.tracks.parameters import MhtParameters
from tracker.types import Setup, Tick

MHT = Parameters()


def scored(setup: Setup, walked: Array, ticks: list[Tick], parameters: Parameters = MHT) -> TargetScore:
    people = np.arange(walked.shape[1])
    estimates = track(setup, ticks, parameters)
    return score([MatchingFrame(people, places, e.target_id, e.position) for places, e in zip(walked, estimates, strict=True)])


@pytest.mark.parametrize("delay", [0, 5])
def test_people_are_tracked_on_hills(delay: int) -> None:
    rng = np.random.default_rng(0)
    setup, walked = synthetic_crowd.setup(ground=synthetic_crowd.hills()), synthetic_crowd.paths(8, 60, rng)
    result = scored(setup, walked, synthetic_crowd.ticks(setup, walked, rng), replace(MHT, delay=delay))
    assert result.mota > 0.9
    assert result.motp_m < 0.15


def test_one_graph_for_each_hypothesis() -> None:
    rng = np.random.default_rng(1)
    setup, walked = synthetic_crowd.setup(), synthetic_crowd.paths(6, 40, rng)
    small = Parameters(targets=MhtParameters(k_h=5, i_bls_max=500))
    assert scored(setup, walked, synthetic_crowd.ticks(setup, walked, rng), small).mota > 0.85


def test_greedy_decisions_stand_at_once() -> None:
    """With an N-scan window of 0 each confirmed person in the global hypothesis has one leaf, and a crowd is tracked nevertheless."""
    rng = np.random.default_rng(1)
    setup, walked = synthetic_crowd.setup(), synthetic_crowd.paths(8, 40, rng)
    ticks, greedy = synthetic_crowd.ticks(setup, walked, rng), Parameters(targets=MhtParameters(n_scan=0.0))
    tracker = Tracker(setup, greedy)
    for tick in ticks:
        tracker.step(tick)
        leaves = tracker._people.filter.leaves
        held = np.isin(leaves.tree, leaves.tree[tracker._people.filter.best])
        assert len(np.unique(leaves.tree[held])) == held.sum()
    assert scored(setup, walked, ticks, greedy).mota > 0.85


def test_estimates_depend_on_the_past_alone() -> None:
    rng = np.random.default_rng(1)
    setup, walked = synthetic_crowd.setup(), synthetic_crowd.paths(5, 30, rng)
    ticks = synthetic_crowd.ticks(setup, walked, rng)
    for a, b in zip(track(setup, ticks, MHT), list(track(setup, ticks[:20], MHT)), strict=False):
        np.testing.assert_array_equal(a.target_id, b.target_id)
        np.testing.assert_array_equal(a.position, b.position)


def test_a_gap_is_bridged_and_keeps_the_id() -> None:
    rng = np.random.default_rng(3)
    setup, walked = synthetic_crowd.setup(), synthetic_crowd.paths(1, 50, rng)
    ticks = synthetic_crowd.ticks(setup, walked, rng, misses=0.0, clutter=0.0, lose=lambda frame, camera, person: 20 <= frame < 25)
    estimates = list(track(setup, ticks, MHT))
    assert {int(i) for e in estimates for i in e.target_id} == {1}
    assert all(len(e.target_id) == 1 for e in estimates[20:25])


def test_people_who_stand_still_are_tracked_after_a_pause_of_the_recording() -> None:
    """The pause is longer than the mean time for which a track follows one person."""
    rng = np.random.default_rng(3)
    setup, walked = synthetic_crowd.setup(), np.repeat(synthetic_crowd.paths(3, 1, rng), 40, axis=0)
    ticks = synthetic_crowd.ticks(setup, walked, rng, misses=0.0, clutter=0.0)
    paused = [replace(tick, time=tick.time + 100 * (tick.index >= 20)) for tick in ticks]
    tracker = Tracker(setup, MHT)
    for tick in paused:
        tracker.step(tick)
        assert np.isfinite(tracker._people.filter.leaves.existence).all()
    assert len(list(track(setup, paused, MHT))[-1].target_id) == 3


@pytest.mark.parametrize(("back", "then"), [(40, 1), (80, 2)])
def test_a_lost_person_is_deleted_and_re_identified_within_eight_seconds(back: int, then: int) -> None:
    """After that a new person is likelier, and no id is used for two people."""
    rng = np.random.default_rng(4)
    setup, walked = synthetic_crowd.setup(), synthetic_crowd.paths(1, back + 20, rng)
    lost = synthetic_crowd.ticks(setup, walked, rng, misses=0, clutter=0, lose=lambda frame, camera, person: 20 <= frame < back)
    estimates = list(track(setup, lost, MHT))
    assert len(estimates[back - 5].target_id) == 0
    assert {int(i) for e in estimates[:20] for i in e.target_id} == {1}
    assert {int(i) for e in estimates[back:] for i in e.target_id} == {then}


@pytest.mark.parametrize("seed", range(3))
def test_two_people_close_together_in_many_views_keep_their_ids(seed: int) -> None:
    """Each may take the boxes of the other in any view, so that children found leaf by leaf are rarely compatible."""
    rng = np.random.default_rng(seed)
    setup = synthetic_crowd.setup(7)
    walked = np.broadcast_to([[0.0, 0.0], [0.6, 0.3]], (60, 2, 2)) + 0.02 * rng.standard_normal((60, 2, 2)).cumsum(axis=0)
    result = scored(setup, walked, synthetic_crowd.ticks(setup, walked, rng), replace(MHT, delay=5))
    assert result.switches == 0
    assert result.mota > 0.97


def test_a_person_who_leaves_all_views_is_reported_up_to_the_last_box(data: Callable[..., Path]) -> None:
    """Person 19 leaves views 5 and 6 at frame 71. The track is deleted some frames later, before the last frames are reported."""
    source = open_sequence(data("pets2009", "S2.L1"), SourceOptions(("5", "6")))
    assert source.truth is not None
    reported = {e.index: e.position for e in track(source.setup, [t for t in source.ticks if t.index < 85], replace(MHT, delay=10))}
    for frame in range(60, 72):
        truth = source.truth[frame]
        place = truth.feet[truth.person_id == 19][0]
        assert np.linalg.norm(reported[frame][:, :2] - place[:2], axis=1).min() < 1


@pytest.mark.parametrize("known", [True, False])
def test_a_person_behind_a_known_post_is_not_a_missed_detection(known: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """Three seconds without a box delete a track that the view should have detected."""
    setup = synthetic_crowd.setup(1)
    post = np.array([[-3.0, -2.5, 0.45, 0.0, 2.5]])
    setup = replace(setup, pillars=post) if known else setup
    # The camera is at (−6, −5) m, the post on its line of sight to (0, 0), and the person crosses that line.
    steps = 3.5 * np.linspace(-1, 1, 100) ** 3
    walked = (steps[:, None] * np.array([-2.5, 3.0]) / np.hypot(2.5, 3.0))[:, None, :]
    rng = np.random.default_rng(0)
    hidden = np.abs(steps) < 0.6
    ticks = synthetic_crowd.ticks(setup, walked, rng, misses=0.0, clutter=0.0, lose=lambda frame, camera, person: bool(hidden[frame]))
    # However uncertain their place becomes.
    monkeypatch.setattr("tracker.mht.tracker.REPORT_SIGMA", 10.0)
    reported = np.array([len(e.target_id) for e in track(setup, ticks)])
    assert reported[~hidden][8:20].all()
    assert reported[hidden][:20].all() == known


def test_clutter_alone_makes_no_tracks() -> None:
    rng = np.random.default_rng(7)
    setup = synthetic_crowd.setup()
    ticks = synthetic_crowd.ticks(setup, np.zeros((80, 0, 2)), rng, clutter=0.3)
    assert sum(len(e.target_id) for e in track(setup, ticks, MHT)) <= 3


def test_the_detection_rate_is_learned() -> None:
    rng = np.random.default_rng(12)
    setup, walked = synthetic_crowd.setup(), synthetic_crowd.paths(5, 100, rng)
    tracker = Tracker(setup, MHT)
    for tick in synthetic_crowd.ticks(setup, walked, rng, misses=0.5):
        tracker.step(tick)
    sensor_model = tracker._people.filter.sensor_model
    found = [sensor_model.detection(camera) for camera in setup.mounts]
    # The prior is 0.9. Boxes outside the gate are not taken, and so not counted.
    assert abs(np.mean(found) - 0.5) < 0.1
    assert max(found) < 0.7
