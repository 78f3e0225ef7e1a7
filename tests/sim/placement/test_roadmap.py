"""How robots drive to places: straight where they can, past others on the right, and there they stand."""

from __future__ import annotations

import numpy as np

from sim.placement.roadmap import steer, straight
from sim.robots.driving import TOP_SPEED

FREE = np.zeros((41, 41), dtype=bool)
FREE[1:-1, 1:-1] = True
ROOM = (FREE, np.zeros(2), 0.25)
PLACES = np.column_stack([np.arange(1.0, 10.0), np.full(9, 5.0)])
ONWARD = np.arange(9)[:, None] + np.sign(np.arange(9) - np.arange(9)[:, None])
NET = (PLACES, ONWARD.astype(np.int32))


def team(*rows: tuple[float, float, float]) -> np.ndarray:
    out = np.zeros((len(rows), 7))
    out[:, :3] = rows
    return out


def told(robots: np.ndarray, goals: list[int], people: list[tuple[float, float]]) -> np.ndarray:
    return steer(robots, np.array(goals), np.array(people, dtype=np.float64).reshape(-1, 2), NET, ROOM)


def test_a_straight_way_is_free_to_the_last_point():
    wall = FREE.copy()
    wall[20, 20] = False
    room = (wall, np.zeros(2), 0.25)
    assert straight(ROOM, (1.0, 5.0), (9.0, 5.0))
    assert not straight(room, (1.0, 5.0), (9.0, 5.0))
    assert straight(room, (1.0, 5.5), (9.0, 5.5))
    assert not straight(room, (1.0, 5.5), (5.0, 5.0))


def test_it_goes_ahead_turns_where_it_looks_elsewhere_and_stands_at_its_goal():
    ahead, aside, there = (told(team((x, 5.0, yaw)), [8], [])[0] for x, yaw in ((3.0, 0.0), (3.0, np.pi / 2), (9.0, 1.0)))
    np.testing.assert_allclose(ahead, [TOP_SPEED, 0.0], atol=1e-12)
    assert aside[0] == 0.0
    assert aside[1] < 0.0
    np.testing.assert_array_equal(there, [0.0, 0.0])


def test_it_passes_on_the_right_else_on_the_left():
    right = told(team((3.0, 5.0, 0.0)), [8], [(4.0, 5.0)])[0]
    left = told(team((3.0, 5.0, 0.0)), [8], [(4.0, 5.0), (3.6, 4.2)])[0]
    behind = told(team((3.0, 5.0, 0.0)), [8], [(2.2, 5.0)])[0]
    assert right[1] < 0.0 < left[1]
    assert behind[1] == 0.0


def test_robots_are_in_each_others_way_as_people_are():
    robots = team((3.0, 5.0, 0.0), (4.0, 5.0, np.pi))
    both = told(robots, [8, 0], [])
    np.testing.assert_array_equal(both[0], told(robots[:1], [8], [(4.0, 5.0)])[0])
    np.testing.assert_array_equal(both[1], told(robots[1:], [0], [(3.0, 5.0)])[0])
