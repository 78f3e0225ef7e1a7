"""Motion of dense crowds against measurements of real ones."""

import numpy as np
import pytest

from sim.crowd.crowd import Crowd, CrowdState, Obstacles
from sim.crowd.goals import GoalPlans
from sim.crowd.social_force import BODY_RADIUS
from tests.benchmarks.crowd import DT
from worlds.terrain.free_space import FEET, FreeSpace, Limits, free_space
from worlds.terrain.heightfield import Heightfield

RADIUS, WIDTH = 10.5, 1.8
"""m: a longer and narrower ring than that of the fit of the constants (8 m and 2.5 m)."""


class Ring(FreeSpace):
    """A ring corridor in which everybody walks anticlockwise."""

    def distance_to(self, goal):
        return np.zeros(self.free.shape)

    def direction_at(self, field, points):
        return np.column_stack([-points[:, 1], points[:, 0]]) / np.maximum(np.hypot(*points.T), 1e-9)[:, None]


def ring(density: float) -> tuple[Crowd, CrowdState]:
    """People of Weidmann's free speed, 1.34 ± 0.26 m/s, at that density 1/m² in a ring."""
    ground = Heightfield.flat([[-12, -12], [12, 12]], 0.1)
    place = free_space(ground, np.abs(np.hypot(*np.moveaxis(ground.nodes, -1, 0)) - RADIUS) > WIDTH / 2, Limits(FEET.slope, FEET.step, 0.2))
    n, lanes = round(density * 2 * np.pi * RADIUS * WIDTH), 4
    angle = np.linspace(0, 2 * np.pi * lanes, n, endpoint=False)
    r = RADIUS + (np.floor(angle / (2 * np.pi)) - (lanes - 1) / 2) * (WIDTH - 0.6) / (lanes - 1)
    speed = np.clip(np.random.default_rng(11).normal(1.34, 0.26, n), 0.6, 2.0)
    plans = GoalPlans.of(speed, np.zeros((1, 2)), np.zeros((n, 1), dtype=np.int64), np.full((n, 1), 1e9))
    crowd = Crowd(Ring(place.free, place.origin, place.spacing), ground, plans)
    return crowd, crowd.start(np.column_stack([r * np.cos(angle), r * np.sin(angle)]), angle + np.pi / 2)


@pytest.mark.parametrize("density", [0.3, 0.7, 1.0, 1.5, 2.0, 2.5, 3.0])
def test_speed_against_density_is_weidmanns(density):
    """Weidmann (1993), Transporttechnik der Fussgänger, eq. 1. The studies it summarizes lie within 25 % or 0.15 m/s of it."""
    crowd, state = ring(density)
    speed = []
    for k in range(400):
        state = crowd.step(state, Obstacles.none(), DT)
        p = state.position
        tangent = np.column_stack([-p[:, 1], p[:, 0]]) / np.hypot(*p.T)[:, None]
        if k >= 200:
            speed.append((state.velocity * tangent).sum(axis=1).mean())
    expected = 1.34 * (1 - np.exp(-1.913 * (1 / density - 1 / 5.4)))
    assert abs(np.mean(speed) - expected) < min(0.15, 0.2 * expected)


def room_with_door(width: float, starts: np.ndarray) -> tuple[Crowd, CrowdState]:
    """Two rooms with a door of `width` m at x = 0. Everybody walks to the far end of the other room."""
    ground = Heightfield.flat([[-9, -5], [9, 5]], 0.1)
    wall = (np.abs(ground.nodes[..., 0]) < 0.15) & (np.abs(ground.nodes[..., 1]) > width / 2 - 1e-9)
    goal, m = (starts[:, 0] > 0).astype(np.int64), len(starts)
    speed = np.clip(np.random.default_rng(1).normal(1.34, 0.26, m), 0.7, 2.0)
    plans = GoalPlans.of(speed, np.array([[8.0, 0.0], [-8.0, 0.0]]), goal[:, None], np.full((m, 1), 1e9))
    crowd = Crowd(free_space(ground, wall, FEET), ground, plans)
    return crowd, crowd.start(starts, np.where(goal == 0, 0.0, np.pi))


def through_the_door(crowd: Crowd, state: CrowdState, seconds: float) -> np.ndarray:
    """Times (m,) s at which people have passed the door, NaN for the others."""
    side, when = np.sign(state.position[:, 0]), np.full(len(state.position), np.nan)
    for k in range(round(seconds / DT)):
        state = crowd.step(state, Obstacles.none(), DT)
        when[np.isnan(when) & (state.position[:, 0] * side < -0.3)] = k * DT
    return when


def rows(x: np.ndarray, count: int) -> np.ndarray:
    """`count` positions 0.6 m apart in rows, x m from the wall."""
    return np.array([[a, b] for a in x for b in np.arange(-3.3, 3.4, 0.6)])[:count]


def test_flow_through_a_door_of_1_20_m_is_as_measured():
    """Specific flow 1.0 to 1.9 /m/s: Kretz, Grünebohm, Schreckenberg (2006), Experimental study of pedestrian flow through a bottleneck; Seyfried
    et al. (2009), New insights into pedestrian flow through bottlenecks."""
    when = np.sort(through_the_door(*room_with_door(1.2, rows(np.arange(-1.2, -8.0, -0.6), 80)), 70.0))
    assert not np.isnan(when).any()
    assert 1.0 < 40 / (when[54] - when[14]) / 1.2 < 1.9


@pytest.mark.parametrize("width", [0.9, 1.2])
def test_people_who_meet_at_a_door_let_each_other_through(width):
    starts = np.concatenate([rows(np.array([-2.0, -2.6]), 8), rows(np.array([2.0, 2.6]), 8)])
    crowd, state = room_with_door(width, starts)
    assert not np.isnan(through_the_door(crowd, state, 60.0)).any()


def test_a_jam_does_not_press_bodies_into_each_other():
    crowd, state = room_with_door(0.9, rows(np.arange(-1.2, -8.0, -0.6), 80))
    for _ in range(400):
        state = crowd.step(state, Obstacles.none(), DT)
    gaps = np.linalg.norm(state.position[:, None] - state.position, axis=2) + np.diag(np.full(80, np.inf))
    assert (gaps.min(axis=1) < 2 * BODY_RADIUS - 0.05).mean() < 0.05
