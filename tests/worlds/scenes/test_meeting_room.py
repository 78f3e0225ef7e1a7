"""Rooms in which people sit: seats are within the walls, at tables, and people fit in."""

from __future__ import annotations

import numpy as np
import pytest

from sim.scenario import Scenario
from sim.simulation.simulation import Simulation
from worlds.engine import mujoco
from worlds.scenes import meeting_room
from worlds.world import World


@pytest.fixture(scope="module")
def rooms() -> list[World]:
    return [meeting_room.build(np.random.default_rng(seed)) for seed in (1, 2, 3)]


def test_seats_are_within_the_walls_and_have_room_for_a_body(rooms: list[World]) -> None:
    for room in rooms:
        low, high = room.ground.extent
        margin = meeting_room.MARGIN + 0.3
        assert len(room.seats) >= 3
        assert ((room.seats[:, :2] > low + margin) & (room.seats[:, :2] < high - margin)).all()
        assert ((room.seats[:, 2] > 0.4) & (room.seats[:, 2] < 0.8)).all()
        apart = np.linalg.norm(room.seats[:, None, :2] - room.seats[:, :2], axis=2) + 9 * np.eye(len(room.seats))
        assert apart.min() > 0.3
        model = room.spec.copy().compile()
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        for x, y, z, _ in room.seats:
            # A ray from the seat upwards meets the ceiling: no table is above it.
            assert mujoco.mj_ray(model, data, np.array([x, y, z + 0.1]), np.array([0.0, 0.0, 1.0]), None, 1, -1, np.zeros(1, np.int32), None) > 1.0


def test_the_same_draws_give_the_same_room() -> None:
    a, b = (meeting_room.build(np.random.default_rng(7)) for _ in range(2))
    np.testing.assert_array_equal(a.seats, b.seats)
    np.testing.assert_array_equal(a.feet.free, b.feet.free)


def test_more_people_sit_than_could_stand(rooms: list[World]) -> None:
    room = max(rooms, key=lambda one: len(one.seats) / one.feet.area)
    seats = len(room.seats)
    simulation = Simulation(Scenario(world=meeting_room.NAME, robots=1, people=seats, frames=2, sitting=1.0, timestep=0.01), world=room)
    np.testing.assert_allclose(np.sort(simulation.feet()[:, 0]), np.sort(room.seats[:, 0]), atol=1e-6)
    before = simulation.joints().copy()
    simulation.change_manner(np.random.default_rng(0))
    assert np.abs(simulation.joints() - before).max() > 0.1
