"""Sitters stay on their seats; groups stand in circles, face each other, and walk on together."""

from itertools import pairwise

import numpy as np
import pytest

from sim.crowd.crowd import Crowd, Obstacles
from sim.crowd.goals import SIZES, SPACING, GoalPlans, Postures, drawn_postures, make_plans
from sim.crowd.social_force import BODY_RADIUS, PAUSE
from tests.sim.crowd.test_crowd import DT, distances, field, history
from tracker.geometry import wrap


def plans_of(m: int) -> GoalPlans:
    return make_plans(field().feet, [np.random.default_rng([1, k]) for k in range(m)], np.random.default_rng(2))


def test_shares_groups_and_sitters_are_as_asked() -> None:
    seats = np.column_stack([np.arange(40.0), np.zeros((40, 2)), np.ones(40)])
    for seed in range(20):
        plans, postures = drawn_postures(plans_of(40), seats, (0.25, 0.5), np.random.default_rng(seed))
        talking = np.flatnonzero(postures.talks >= 0)
        assert len(postures.sitters) == len(postures.seat) == 10
        assert len(np.unique(postures.seat[:, 0])) == 10
        assert not set(talking) & set(postures.sitters)
        assert len(talking) in (19, 20)
        sizes = np.bincount(postures.talks[talking])
        assert set(sizes.tolist()) <= set(SIZES)
        # Groups are runs of adjacent people with one leader, one way and one time.
        for group in range(len(sizes)):
            members = np.flatnonzero(postures.talks == group)
            assert (np.diff(members) == 1).all()
            assert (plans.group[members] == members[0]).all()
            assert (plans.itinerary[members] == plans.itinerary[members[0]]).all()
        assert (plans.group[postures.sitters] == postures.sitters).all()
        assert (np.bincount(plans.group, minlength=40)[postures.sitters] == 1).all()
    with pytest.raises(ValueError, match="10 people shall sit, needs at most 4"):
        drawn_postures(plans_of(40), seats[:4], (0.25, 0.0), np.random.default_rng(0))


@pytest.mark.parametrize("count", [2, 3, 5])
def test_people_who_meet_form_a_circle_and_face_its_centre(count: int) -> None:
    world = field()
    goals = np.array([[2.0, 0.0], [-6.0, 0.0]])
    plans = GoalPlans.of(np.full(count, 1.2), goals, np.tile([0, 1], (count, 1)), np.tile([20.0, 60.0], (count, 1)))
    plans = GoalPlans(**vars(plans) | {"group": np.zeros(count, np.int64)})
    talkers = Postures(np.zeros(0, np.int64), np.zeros((0, 4)), np.zeros(count, np.int64))
    crowd = Crowd(world.feet, world.terrain, plans, talkers)
    starts = np.column_stack([np.full(count, -3.0) - 0.7 * np.arange(count), 0.5 * (-1.0) ** np.arange(count)])
    body = Crowd(world.feet, world.terrain, plans).start(starts, np.zeros(count))
    states = history(crowd, body, 16.0)
    # From 12 s on they have met.
    for state in states[240:]:
        assert (state.body[:, PAUSE] > 0).all()
        away = state.position - state.position.mean(axis=0)
        assert np.abs(wrap(np.arctan2(-away[:, 1], -away[:, 0]) - state.heading)).max() < 0.2
        assert np.hypot(*away.T) == pytest.approx(0.5 * SPACING / np.sin(np.pi / count), abs=0.15)
        assert distances(state.position).min() > 2 * BODY_RADIUS
    # Nobody jumps, and they walk on to the next goal.
    steps = np.array([np.linalg.norm(b.position - a.position, axis=1).max() for a, b in pairwise(states)])
    assert steps.max() < 2.5 * DT
    last = history(crowd, states[-1], 16.0)[-1]
    assert np.linalg.norm(last.position - goals[1], axis=1).max() < 2.0


def test_groups_begin_in_circles_and_sitters_on_seats() -> None:
    world = field()
    seats = np.array([[0.0, -2.5, 0.45, 1.2], [3.0, 2.5, 0.45, -1.0], [5.0, 0.0, 0.45, 2.0]])
    plans, postures = drawn_postures(plans_of(10), seats, (0.3, 0.5), np.random.default_rng(1))
    crowd = Crowd(world.feet, world.terrain, plans, postures)
    robot = np.array([[-3.0, 0.0]])
    start = crowd.start(world.feet.sample(np.random.default_rng(1), 10, 0.1, 1.2), np.zeros(10), robot)
    talking = np.flatnonzero((postures.talks >= 0) & (start.body[:, PAUSE] > 0))
    assert len(talking) >= 4
    assert np.linalg.norm(start.position[talking] - robot, axis=1).min() > 0.7
    still = Obstacles(robot, np.zeros((1, 2)), np.array([0.3]))
    for state in history(crowd, start, 5.0, still):
        np.testing.assert_array_equal(state.position[postures.sitters], postures.seat[:, :2])
        np.testing.assert_array_equal(state.heading[postures.sitters], postures.seat[:, 3])
        assert (state.velocity[postures.sitters] == 0).all()
