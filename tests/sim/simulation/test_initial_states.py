"""Initial states of robots and people, random or given, and the drivers of the robots."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sim.robots.driving import DriveState, Motion, Route, Traffic
from sim.scenario import Scenario
from sim.simulation.initial_states import (
    PERSON_ROVER_DISTANCE,
    ROVER_DISTANCE,
    InitialStates,
    clear_of_robots,
    draw_places,
    draw_robots,
    make_crowd,
    resting_pose,
)
from sim.simulation.simulation import Simulation
from tests.sim.yard import yard
from tracker.geometry import rotation_from_quaternion

SCENARIO = Scenario(robots=2, people=3, frames=6)
TOLD = np.array([[-3.0, -2.0, 0.5], [2.0, 3.0, -2.0]])


class Ahead:
    """A driver that goes straight ahead at constant speed, m/s."""

    def __init__(self, speed: float) -> None:
        self.speed = speed

    def start(self, position: np.ndarray) -> DriveState:
        return DriveState(Route.through(np.stack([position, position])), 0.0, 0, 0.0, 0.0, 0.0, 0.0)

    def step(self, drive: DriveState, motion: Motion, traffic: Traffic, dt: float) -> DriveState:
        return replace(drive, speed=self.speed)


def begun(*speeds: float) -> Simulation:
    world, people = yard(), [np.random.default_rng(k) for k in range(SCENARIO.people)]
    free = clear_of_robots(TOLD[:, :2], draw_places(SCENARIO, world.feet))
    crowd, state = make_crowd(SCENARIO, world, people, free)
    return Simulation(SCENARIO, world, start=InitialStates(TOLD, tuple(Ahead(s) for s in speeds), state, crowd))


def test_given_initial_states_and_drivers_are_used() -> None:
    simulation = begun(0.0, 0.5)
    np.testing.assert_allclose(simulation.motions(), np.column_stack([TOLD, np.zeros((2, 2))]), atol=0.03)
    people = simulation.crowd_state.position
    np.testing.assert_array_equal(simulation.feet()[:, :2], people)
    assert np.linalg.norm(people[:, None] - TOLD[:, :2], axis=2).min() > PERSON_ROVER_DISTANCE
    for _ in range(6):
        simulation.step()
    gone = np.linalg.norm(simulation.motions()[:, :2] - TOLD[:, :2], axis=1)
    assert gone[0] < 0.03
    assert 0.3 < gone[1] < 0.55
    assert simulation.motions()[1, 3] == pytest.approx(0.5, abs=0.05)


def test_another_driver_takes_over() -> None:
    simulation = begun(0.0, 0.5)
    simulation.step()
    simulation.set_drivers([Ahead(0.4), Ahead(0.0)], simulation.drives)
    for _ in range(6):
        simulation.step()
    assert simulation.motions()[0, 3] == pytest.approx(0.4, abs=0.05)
    assert simulation.motions()[1, 3] == pytest.approx(0.0, abs=0.05)
    assert [drive.speed for drive in simulation.drives] == [0.4, 0.0]


def test_rovers_are_drawn_apart_and_rest_on_the_ground() -> None:
    world = yard()
    robots = draw_robots(replace(SCENARIO, robots=6), world.wheels)
    gaps = np.linalg.norm(robots[:, None, :2] - robots[None, :, :2], axis=2) + 1e9 * np.eye(6)
    assert gaps.min() >= ROVER_DISTANCE
    np.testing.assert_array_equal(robots, draw_robots(replace(SCENARIO, robots=6), world.wheels))
    with pytest.raises(ValueError, match="robots is 64, more than pilsun holds"):
        draw_robots(replace(SCENARIO, robots=64), world.wheels)
    x, y, yaw = robots[0]
    pose = resting_pose(world.terrain, np.array([x, y]), yaw)
    ahead = rotation_from_quaternion(pose[3:])[:, 0]
    assert np.arctan2(ahead[1], ahead[0]) == pytest.approx(yaw, abs=0.1)
    assert 0.0 < pose[2] - world.terrain.height_at(np.array([[x, y]]))[0] < 0.5


def test_initial_states_for_other_numbers_are_refused() -> None:
    world, people = yard(), [np.random.default_rng(k) for k in range(3)]
    crowd, state = make_crowd(SCENARIO, world, people, draw_places(SCENARIO, world.feet))
    with pytest.raises(ValueError, match="start has 3 people, needs 4"):
        Simulation(replace(SCENARIO, people=4), world, start=InitialStates(TOLD, (Ahead(0.0), Ahead(0.0)), state, crowd))
    with pytest.raises(ValueError, match=r"start has robots of shape \(2, 3\) and 1 drivers, needs \(2, 3\) and 2"):
        Simulation(SCENARIO, world, start=InitialStates(TOLD, (Ahead(0.0),), state, crowd))


def test_too_few_places_are_refused() -> None:
    people = [np.random.default_rng(k) for k in range(3)]
    with pytest.raises(ValueError, match="people is 3, needs at most 2: more do not fit beside 2 robots"):
        make_crowd(SCENARIO, yard(), people, np.array([[0.0, 0.0], [2.0, 0.0]]))
