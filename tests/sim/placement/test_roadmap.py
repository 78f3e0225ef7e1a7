"""Steering along the roadmap: straight segments, avoidance of others, and stopping at the goal."""

from __future__ import annotations

import numpy as np

from sim.placement.roadmap import segment_is_free, steer
from sim.robots.driving import TOP_SPEED

FREE = np.zeros((41, 41), dtype=bool)
FREE[1:-1, 1:-1] = True
SPACE = (FREE, np.zeros(2), 0.25)
NODES = np.column_stack([np.arange(1.0, 10.0), np.full(9, 5.0)])
NEXT_NODE = np.arange(9)[:, None] + np.sign(np.arange(9) - np.arange(9)[:, None])
GRAPH = (NODES, NEXT_NODE.astype(np.int32))


def team(*rows: tuple[float, float, float]) -> np.ndarray:
    out = np.zeros((len(rows), 7))
    out[:, :3] = rows
    return out


def commands(robots: np.ndarray, goals: list[int], people: list[tuple[float, float]]) -> np.ndarray:
    return steer(robots, np.array(goals), np.array(people, dtype=np.float64).reshape(-1, 2), GRAPH, SPACE)


def test_a_free_segment_is_free_to_its_last_point():
    wall = FREE.copy()
    wall[20, 20] = False
    space = (wall, np.zeros(2), 0.25)
    assert segment_is_free(SPACE, (1.0, 5.0), (9.0, 5.0))
    assert not segment_is_free(space, (1.0, 5.0), (9.0, 5.0))
    assert segment_is_free(space, (1.0, 5.5), (9.0, 5.5))
    assert not segment_is_free(space, (1.0, 5.5), (5.0, 5.0))


def test_it_drives_ahead_turns_on_the_spot_and_stops_at_the_goal():
    ahead, aside, there = (commands(team((x, 5.0, yaw)), [8], [])[0] for x, yaw in ((3.0, 0.0), (3.0, np.pi / 2), (9.0, 1.0)))
    np.testing.assert_allclose(ahead, [TOP_SPEED, 0.0], atol=1e-12)
    assert aside[0] == 0.0
    assert aside[1] < 0.0
    np.testing.assert_array_equal(there, [0.0, 0.0])


def test_it_passes_on_the_right_or_else_on_the_left():
    right = commands(team((3.0, 5.0, 0.0)), [8], [(4.0, 5.0)])[0]
    left = commands(team((3.0, 5.0, 0.0)), [8], [(4.0, 5.0), (3.6, 4.2)])[0]
    behind = commands(team((3.0, 5.0, 0.0)), [8], [(2.2, 5.0)])[0]
    assert right[1] < 0.0 < left[1]
    assert behind[1] == 0.0


def test_robots_avoid_each_other_as_they_avoid_people():
    robots = team((3.0, 5.0, 0.0), (4.0, 5.0, np.pi))
    both = commands(robots, [8, 0], [])
    np.testing.assert_array_equal(both[0], commands(robots[:1], [8], [(4.0, 5.0)])[0])
    np.testing.assert_array_equal(both[1], commands(robots[1:], [0], [(3.0, 5.0)])[0])
