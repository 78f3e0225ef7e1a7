"""The bound of the robots' places: two ways to it, and what a filter makes of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sim.scenario import Scenario
from sim.stress.bounds import ate_bound
from sim.stress.footage import TrialData
from sim.stress.map_truth import map_score
from sim.stress.sweeps import Case
from tests.tracker.slam.test_inter_robot import with_companions
from tests.tracker.walled_room import Room, simulate
from tracker.ekf.linearization import linearise
from tracker.ekf.state import JointState
from tracker.metrics import cramer_rao
from tracker.pipeline import track
from tracker.sequence.results import Results
from tracker.slam.inter_robot import identify
from tracker.types import Truth

ROOM = Room(seed=3, robots=2, ticks=11, landmarks=40, named=True, miss=0.2)
NOBODY = (np.zeros(0, dtype=np.int64), np.zeros((0, 3)), np.zeros((0, 2)))


@pytest.fixture(scope="module")
def footage() -> TrialData:
    setup, ticks, poses, points = simulate(ROOM)
    truth = tuple(Truth(tick.index, true, *NOBODY) for tick, true in zip(ticks, poses, strict=True))
    case = Case("room/0", "room", "none", 0, Scenario())
    return TrialData(case, setup, ticks, truth, [{} for _ in ticks], setup, ticks, {}, points)


def test_the_recursion_and_the_whole_problem_agree(footage: TrialData) -> None:
    frames = []
    for tick, truth, odometry in zip(footage.ticks, footage.truth, footage.in_memory().odometry(), strict=True):
        seen = {v.camera: (v.sightings.subject, v.sightings.covariance) for v in tick.views if v.sightings is not None}
        frames.append(cramer_rao.BoundFrame(truth.T_world_robot, odometry, seen))
    assert footage.landmarks is not None
    places = dict(enumerate(footage.landmarks))
    found = cramer_rao.variances(footage.setup, frames, places)
    # The problem takes the bound at every other frame here, and drops sightings of which it is not sure whose they are.
    assert cramer_rao.ate_bound(found[[2, 4, 6, 8, 10]]) == pytest.approx(ate_bound(footage), rel=0.02)
    # An offset that is estimated as well costs something.
    more = cramer_rao.variances(footage.setup, frames, places, (0.02, 0.02, 0.02))
    assert cramer_rao.ate_bound(more) > cramer_rao.ate_bound(found)


def test_robots_that_see_each_other_lower_the_bound() -> None:
    """Of a first frame alone it is what the filter makes of the starts at the truth, where no landmark is known."""
    setup, ticks, poses = with_companions(Room(seed=3, robots=3, ticks=1, landmarks=1), np.random.default_rng(0))
    truth, case = (Truth(1, poses[0], *NOBODY),), Case("room/0", "room", "none", 0, Scenario())
    views = tuple(replace(view, sightings=None, odometry=None) for view in ticks[0].views)
    blind = tuple(replace(view, companions=None) for view in views)
    bounds = []
    for seen in (views, blind):
        told = [replace(ticks[0], views=seen)]
        bounds.append(ate_bound(TrialData(case, setup, told, truth, [{}], setup, told, {}, np.zeros((1, 3)))))
    joint, team = JointState(1, 1, None), {}
    for name, start in setup.starts.items():
        assert start is not None
        team[name] = joint.join(replace(start, T_world_robot=poses[0][name]))
    for view in views:
        mount = setup.mounts[view.camera]
        assert view.companions is not None
        seen_at_all = identify(setup, mount, view.companions, team)
        joint.update(lambda mount=mount, seen=seen_at_all: linearise(joint, team[mount.robot], None, None, seen), 1, np.inf)  # type: ignore[misc]
    expected = np.mean([np.sqrt(joint.covariance(robot)[:3, :3].trace()) for robot in team.values()])
    # The filter's mean moves by the noise of the bearings, the bound's does not.
    assert bounds[0] == pytest.approx(expected, rel=1e-3)
    assert bounds[0] < 0.9 * (bounds[1] or 0)


def test_what_the_tracker_saw_gives_a_bound_and_a_map(footage: TrialData) -> None:
    results = Results.of(track(footage.setup, footage.ticks), {})
    survey = results.survey
    assert survey is not None
    assert set(survey.final.tolist()) <= set(survey.places)
    for tick, sighted in zip(footage.ticks, survey.sighted, strict=True):
        for view in tick.views:
            assert view.sightings is not None
            assert len(sighted[footage.setup.mounts[view.camera].robot]) <= len(view.sightings)
    poses, odometry = [t.T_world_robot for t in footage.truth], footage.in_memory().odometry()
    bound = cramer_rao.surveyed(footage.setup, poses, odometry, survey)
    # The same sightings of fewer landmarks, and from a start that is 0.035 m off.
    assert bound is not None
    assert 0.3 * (ate_bound(footage) or 0) < bound < 0.05
    score = map_score(footage, results)
    assert score is not None
    d = score.to_dict()
    assert d["map_aligned_m"] is not None
    assert d["map_aligned_m"] < 0.3
    assert (d["map_complete"] or 0) > 0.2
