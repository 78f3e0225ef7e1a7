"""Bounds: of robots against the batch problem and a filter, of people against differences and draws, of cliques by hand."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from sim.scenario import Scenario
from sim.stress.bounds import HEAD, NEAR, ate_bound, box_information, clique_gap, map_score, mean_distance, score_map
from sim.stress.sweeps import Case
from sim.stress.trial_data import TrialData
from tests.tracker.slam.test_inter_robot import with_robot_detections
from tests.tracker.walled_room import Room, simulate
from tracker.clique.local_search import Graph
from tracker.ekf.linearization import linearize
from tracker.ekf.state import JointState
from tracker.geometry import Pose
from tracker.mht.global_hypothesis import dump
from tracker.pipeline import track
from tracker.sequence.results import Results
from tracker.slam import cramer_rao
from tracker.slam.data_association import identify
from tracker.types import Truth

SPARE_LANDMARKS = Room(seed=3, robots=2, ticks=11, landmarks=40, named=True, miss=0.2)
LANDMARKS = np.array([[0.0, 0, 0], [3, 0, 0], [0, 3, 0], [3, 3, 1]])
NOBODY = (np.zeros(0, dtype=np.int64), np.zeros((0, 3)), np.zeros((0, 2)))


@pytest.fixture(scope="module")
def data() -> TrialData:
    setup, ticks, poses, points = simulate(SPARE_LANDMARKS)
    truth = tuple(Truth(tick.index, true, *NOBODY) for tick, true in zip(ticks, poses, strict=True))
    case = Case("room/0", "room", "none", 0, Scenario())
    return TrialData(case, setup, ticks, truth, [{} for _ in ticks], setup, ticks, {}, points)


def test_the_recursion_and_the_batch_problem_agree(data: TrialData) -> None:
    frames = []
    for tick, truth, odometry in zip(data.ticks, data.truth, data.in_memory().odometry(), strict=True):
        seen = {v.camera: (v.sightings.subject, v.sightings.covariance) for v in tick.views if v.sightings is not None}
        frames.append(cramer_rao.BoundFrame(truth.T_world_robot, odometry, seen))
    assert data.landmarks is not None
    places = dict(enumerate(data.landmarks))
    found = cramer_rao.position_variances(data.setup, frames, places)
    # The batch problem evaluates every other frame here, and leaves out sightings without a clear landmark.
    assert cramer_rao.ate_bound(found[[2, 4, 6, 8, 10]]) == pytest.approx(ate_bound(data), rel=0.02)
    # Estimating odometry biases as well raises the bound.
    more = cramer_rao.position_variances(data.setup, frames, places, (0.02, 0.02, 0.02))
    assert cramer_rao.ate_bound(more) > cramer_rao.ate_bound(found)


def test_robots_that_see_each_other_lower_the_bound() -> None:
    """At the first frame, without landmarks, the bound is the covariance of the filter at the truth."""
    setup, ticks, poses = with_robot_detections(Room(seed=3, robots=3, ticks=1, landmarks=1), np.random.default_rng(0))
    truth, case = (Truth(1, poses[0], *NOBODY),), Case("room/0", "room", "none", 0, Scenario())
    views = tuple(replace(view, sightings=None, odometry=None) for view in ticks[0].views)
    blind = tuple(replace(view, robot_detections=None) for view in views)
    bounds = []
    for seen in (views, blind):
        given = [replace(ticks[0], views=seen)]
        bounds.append(ate_bound(TrialData(case, setup, given, truth, [{}], setup, given, {}, np.zeros((1, 3)))))
    state, team = JointState(1, 1, None), {}
    for name, start in setup.starts.items():
        assert start is not None
        team[name] = state.add_robot(replace(start, T_world_robot=poses[0][name]))
    for view in views:
        mount = setup.mounts[view.camera]
        assert view.robot_detections is not None
        identified = identify(setup, mount, view.robot_detections, team)
        state.update(lambda mount=mount, seen=identified: linearize(state, team[mount.robot], None, None, seen), 1, np.inf)  # type: ignore[misc]
    expected = np.mean([np.sqrt(state.covariance(robot)[:3, :3].trace()) for robot in team.values()])
    # The filter linearizes at its mean, which has noise; the bound linearizes at the truth.
    assert bounds[0] == pytest.approx(expected, rel=1e-3)
    assert bounds[0] < 0.9 * (bounds[1] or 0)


def test_sightings_of_the_tracker_give_a_bound_and_a_map_score(data: TrialData) -> None:
    results = Results.of(track(data.setup, data.ticks), {})
    history = results.landmark_history
    assert history is not None
    assert set(history.final.tolist()) <= set(history.positions)
    for tick, sighted in zip(data.ticks, history.sighted, strict=True):
        for view in tick.views:
            assert view.sightings is not None
            assert len(sighted[data.setup.mounts[view.camera].robot]) <= len(view.sightings)
    poses, odometry = [t.T_world_robot for t in data.truth], data.in_memory().odometry()
    bound = cramer_rao.bound_of_map(data.setup, poses, odometry, history)
    # The sightings are the same, of fewer landmarks, and the start has an error of 0.035 m.
    assert bound is not None
    assert 0.3 * (ate_bound(data) or 0) < bound < 0.05
    d = map_score(data, results)
    assert d is not None
    assert d["map_aligned_m"] is not None
    assert d["map_aligned_m"] < 0.3
    assert (d["map_complete"] or 0) > 0.2


def test_the_gap_is_the_share_of_weight_that_cliques_lack(tmp_path: Path) -> None:
    assert clique_gap(tmp_path) is None
    # Three vertices in conflict, and one that is compatible with all: the optimum is 5 + 1.
    graph = Graph.from_conflicts(np.array([5.0, 4.0, 3.0, 1.0]), np.array([[0, 1], [0, 2], [1, 2]]))
    dump(tmp_path, "00000000-0", graph, np.array([0, 3]))
    assert clique_gap(tmp_path) == 0.0
    # The second clique weighs 3 + 1, which makes 10 of 12.
    dump(tmp_path, "00000001-0", graph, np.array([2, 3]))
    assert clique_gap(tmp_path) == pytest.approx(2 / 12)


def test_the_mean_distance_agrees_with_random_draws() -> None:
    rng = np.random.default_rng(0)
    covariances = np.array([np.diag([1.0, 1.0]), np.diag([4.0, 1e-12]), [[2.0, 0.7], [0.7, 0.5]]])
    for P, computed in zip(covariances, mean_distance(covariances), strict=True):
        drawn = np.linalg.norm(rng.multivariate_normal(np.zeros(2), P, 200_000), axis=1).mean()
        assert computed == pytest.approx(drawn, rel=5e-3)


def test_the_information_of_a_box_is_that_of_its_edges() -> None:
    """Against finite differences of the azimuth of the middle and of the elevations of feet and head."""
    eye, variance, step = np.array([3.0, -4.0, 1.5]), 1e-4, 1e-6

    def angles(feet: np.ndarray) -> np.ndarray:
        away = np.array([*feet, 0.0]) - eye
        r = np.hypot(away[0], away[1])
        return np.array([np.arctan2(away[1], away[0]), np.arctan2(away[2], r), np.arctan2(away[2] + HEAD, r)])

    J = np.stack([(angles(step * axis) - angles(-step * axis)) / (2 * step) for axis in np.eye(2)], axis=1)
    expected = J.T @ np.diag([2.0, 1.0, 1.0]) @ J / variance
    np.testing.assert_allclose(box_information(eye, variance), expected, rtol=1e-6)


def test_a_map_by_hand() -> None:
    # Two landmarks are 0.3 m off, one is exact, a copy of it and one in the middle of nowhere are ghosts; the fourth true one is not there.
    landmarks = np.array([[0.3, 0, 0], [3, 0.3, 0], [0, 3, 0], [0, 3, 0.1], [1.5, 1.5, 0]])
    d = score_map(LANDMARKS, landmarks, np.ones(4, dtype=bool))
    assert_allclose([d["map_m"], d["map_aligned_m"], d["map_complete"], d["map_ghosts"]], [np.sqrt(0.06)] * 2 + [0.75, 0.4])
    few = score_map(LANDMARKS, landmarks, np.array([True, False, False, True]))
    assert few["map_complete"] == 0.5


def test_the_map_is_moved_with_the_team() -> None:
    T = Pose.exp([2, -1, 0.5, 0.1, 0.2, 1.0])
    d = score_map(LANDMARKS, T.apply(LANDMARKS), np.ones(4, dtype=bool), T.inverse())
    assert_allclose(d["map_aligned_m"], 0, atol=1e-9)
    assert (d["map_complete"], d["map_ghosts"]) == (1, 0)
    assert d["map_m"] is not None
    assert d["map_m"] > NEAR
    assert score_map(LANDMARKS, T.apply(LANDMARKS), np.ones(4, dtype=bool))["map_complete"] != 1


def test_a_map_of_nothing_is_undefined() -> None:
    none, all_ = score_map(LANDMARKS, np.zeros((0, 3)), np.ones(4, dtype=bool)), score_map(np.zeros((0, 3)), LANDMARKS, np.ones(0, dtype=bool))
    assert list(none.values()) == [None, None, 0.0, None]
    assert list(all_.values()) == [None, None, None, 1.0]
