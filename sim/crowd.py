"""Where people go: goals, avoidance of each other, of walls and of robots, pauses, speed on slopes. No MuJoCo in it.

People obey the social force of Moussaïd et al. (2009), Experimental study of the behavioural mechanisms underlying self-organization in
human crowds, Proc. R. Soc. B 276, with their constants, plus a stiff push where bodies would touch (Helbing, Farkas, Vicsek 2000).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numba import njit
from numpy.typing import NDArray

from tracker.geometry import Array, frozen, wrap
from worlds.heightfield import Heightfield
from worlds.walkable import Walkable

"""s: about how far the crowd is moved at once."""
BODY_RADIUS = 0.23
"""m: bodies closer than twice this overlap."""
PREFERRED_SPEED, SPEED_SPREAD = 1.2, 0.2
"""m/s: mean and sigma of the speed that people walk at on level ground (1.3 in the open, less indoors)."""
RELAXATION = 0.54
"""s in which a walker takes up the speed that he wants (Moussaïd et al.)."""
ARRIVED = 0.7
"""m from a goal at which it counts as reached."""
PATIENCE = 4.0
"""s after which somebody who cannot get on wants to go elsewhere."""
TURN_RATE = 2.5
"""rad/s: how fast a body turns to where it goes."""
_WALL_PUSH, _WALL_RANGE = 3.0, 0.1
_CLEAR = 0.02


@dataclass(frozen=True, eq=False)
class CrowdState:
    """m people: position (m, 2) m, velocity (m, 2) m/s, heading (m,) rad, visit (m,) how many goals are behind them, pause (m,) s still to
    stand, stuck (m,) s without getting on."""

    position: Array
    velocity: Array
    heading: Array
    visit: NDArray[np.int64]
    pause: Array
    stuck: Array

    def __post_init__(self) -> None:
        m = len(self.position)
        for name, shape in (("position", (m, 2)), ("velocity", (m, 2)), ("heading", (m,)), ("pause", (m,)), ("stuck", (m,))):
            object.__setattr__(self, name, frozen(getattr(self, name), shape, name))


@dataclass(frozen=True, eq=False)
class Obstacles:
    """What people walk around: position (k, 2) m, velocity (k, 2) m/s, radius (k,) m."""

    position: Array
    velocity: Array
    radius: Array

    @staticmethod
    def none() -> Obstacles:
        return Obstacles(np.zeros((0, 2)), np.zeros((0, 2)), np.zeros(0))


@dataclass(frozen=True, eq=False)
class Plans:
    """What people want: speed (m,) m/s on the level, goals (g, 2) m, itinerary (m, k) of goals, gone through again and again, and pauses
    (m, k) s at each of them."""

    speed: Array
    goals: Array
    itinerary: NDArray[np.int64]
    pauses: Array


@dataclass(frozen=True, eq=False)
class Crowd:
    """The people of one place. It holds what does not change; `step` gives the next state."""

    feet: Walkable
    ground: Heightfield
    plans: Plans
    _ways: dict[int, Array] = field(default_factory=dict, init=False, repr=False)

    def start(self, position: Array, heading: Array) -> CrowdState:
        """Everybody at position (m, 2) m, about to go."""
        m = len(position)
        return CrowdState(position, np.zeros((m, 2)), heading, np.zeros(m, dtype=np.int64), np.zeros(m), np.zeros(m))

    def goal(self, state: CrowdState) -> NDArray[np.int64]:
        """(m,): the goal that each walks to or stands at."""
        return np.take_along_axis(self.plans.itinerary, (state.visit % self.plans.itinerary.shape[1])[:, None], axis=1)[:, 0]

    def step(self, state: CrowdState, obstacles: Obstacles, dt: float) -> CrowdState:
        """The state `dt` s later."""
        if not len(state.position):
            return state
        direction = self._direction(state)
        walking = state.pause <= 0
        wanted = direction * (self.plans.speed * self._slope_factor(state.position, direction) * walking)[:, None]
        force = (wanted - state.velocity) / RELAXATION + self._wall_force(state.position)
        force += _social_force(state.position, state.velocity, obstacles.position, obstacles.velocity, obstacles.radius)
        velocity = state.velocity + force * dt
        speed = np.hypot(*velocity.T)
        velocity *= np.minimum(1.0, 1.3 * self.plans.speed * _turned(state.heading, velocity) / np.maximum(speed, 1e-9))[:, None]
        # Who stands is not pushed about by people that only pass.
        velocity[~walking & (np.hypot(*velocity.T) < 0.12)] = 0.0
        position = _apart(state.position + velocity * dt, obstacles.position, obstacles.radius)
        position = self._freed(position, state.position)
        return self._decided(replace(state, velocity=(position - state.position) / dt, position=position), wanted, dt)

    def _direction(self, state: CrowdState) -> Array:
        """(m, 2) unit, the way to the goal."""
        goal = self.goal(state)
        way = np.zeros_like(state.position)
        for number in map(int, np.unique(goal)):
            if number not in self._ways:
                self._ways[number] = self.feet.direction_at(self.feet.distance_to(self.plans.goals[number]), self._nodes).reshape(*self._shape, 2)
            mine = goal == number
            way[mine] = self._between(self._ways[number], state.position[mine])
        return way / np.maximum(np.hypot(*way.T), 1e-9)[:, None]

    @property
    def _shape(self) -> tuple[int, ...]:
        return self.feet.free.shape

    @property
    def _nodes(self) -> Array:
        """(rows · columns, 2) m: the grid points of free space."""
        i, j = np.indices(self._shape).reshape(2, -1)
        return self.feet.origin + self.feet.spacing * np.stack([j, i], axis=1)

    @cached_property
    def _walls(self) -> Array:
        """(rows, columns, 3): clearance m and the unit direction away from walls at each grid point."""
        return np.column_stack([self.feet.clearance_at(self._nodes), self.feet.away_at(self._nodes)]).reshape(*self._shape, 3)

    def _between(self, values: Array, points: Array) -> Array:
        """(n, k) of values (rows, columns, k) on the grid of free space, at points (n, 2) m."""
        return _bilinear(values, (points - self.feet.origin) / self.feet.spacing)

    def _slope_factor(self, position: Array, direction: Array) -> Array:
        """(m,) of walking speed, from the slope of the next stride (Tobler 1993: exp(−3.5 |slope + 0.05|))."""
        rise = self.ground.height_at(position + 0.5 * direction) - self.ground.height_at(position - 0.2 * direction)
        return np.maximum(np.exp(-3.5 * (np.abs(rise / 0.7 + 0.05) - 0.05)), 0.3)

    def _wall_force(self, position: Array) -> Array:
        walls = self._between(self._walls, position)
        return walls[:, 1:] * (_WALL_PUSH * np.exp(-np.maximum(walls[:, :1], 0.0) / _WALL_RANGE))

    def _freed(self, position: Array, before: Array) -> Array:
        """position (m, 2) m, brought back to free space where it has left it; `before` where that fails."""
        for _ in range(3):
            walls = self._between(self._walls, position)
            short = np.maximum(_CLEAR - walls[:, :1], 0.0)
            if not short.any():
                return position
            position = position + (short + 0.01 * (short > 0)) * walls[:, 1:]
        lost = self.feet.clearance_at(position) <= 0
        return np.where(lost[:, None], before, position)

    def _decided(self, state: CrowdState, wanted: Array, dt: float) -> CrowdState:
        """Headings, arrivals, pauses and changes of mind."""
        speed = np.hypot(*state.velocity.T)
        towards = np.where(speed > 0.15, np.arctan2(state.velocity[:, 1], state.velocity[:, 0]), state.heading)
        heading = wrap(state.heading + np.clip(wrap(towards - state.heading), -TURN_RATE * dt, TURN_RATE * dt))
        standing = state.pause > 0
        pause = np.maximum(state.pause - dt, 0.0)
        leaves = standing & (pause <= 0)
        stuck = np.where(~standing & (speed < 0.25 * np.hypot(*wanted.T) + 0.05), state.stuck + dt, 0.0)
        gives_up = stuck > PATIENCE
        arrives = ~standing & (np.hypot(*(self.plans.goals[self.goal(state)] - state.position).T) < ARRIVED)
        stay = np.take_along_axis(self.plans.pauses, (state.visit % self.plans.pauses.shape[1])[:, None], axis=1)[:, 0]
        return replace(
            state, heading=heading, pause=np.where(arrives, stay, pause), stuck=np.where(gives_up, 0.0, stuck),
            visit=state.visit + (leaves | (gives_up & ~arrives)),
        )  # fmt: skip


def make_plans(feet: Walkable, rngs: list[np.random.Generator], goal_rng: np.random.Generator) -> Plans:
    """Plans for as many people as there are streams: each draws speed, goals and pauses from the own one, the goals are shared.

    Raises ValueError where free space is too small for goals.
    """
    count = int(np.clip(feet.area / 8.0, 4, 12))
    apart = 0.5 * math.sqrt(feet.area / count)
    goals = feet.sample(goal_rng, count, 0.15, apart)
    length = 32
    itinerary, pauses, speed = np.zeros((len(rngs), length), dtype=np.int64), np.zeros((len(rngs), length)), np.zeros(len(rngs))
    for i, rng in enumerate(rngs):
        speed[i] = np.clip(rng.normal(PREFERRED_SPEED, SPEED_SPREAD), 0.7, 1.8)
        steps = np.cumsum(rng.integers(1, count, length))
        itinerary[i] = (rng.integers(count) + steps) % count
        # Half of the goals are only passed; at the others people stay for some seconds.
        pauses[i] = np.where(rng.random(length) < 0.5, 0.1, rng.uniform(1.5, 6.0, length))
    return Plans(speed, goals, itinerary, pauses)


def _turned(heading: Array, velocity: Array) -> Array:
    """(m,) the share of the top speed that a body reaches which faces `heading`: people turn first, sideways and backwards is slow."""
    along = velocity[:, 0] * np.cos(heading) + velocity[:, 1] * np.sin(heading)
    return np.clip(0.3 + 0.7 * along / np.maximum(np.hypot(*velocity.T), 1e-9), 0.3, 1.0)


@njit(cache=True)
def _bilinear(values: Array, places: Array) -> Array:
    """values (rows, columns, k) at places (n, 2), column and row counted from 0, the nearest inside outside → (n, k)."""
    rows, columns, k = values.shape
    out = np.empty((len(places), k))
    for n in range(len(places)):
        x, y = min(max(places[n, 0], 0.0), columns - 1.0), min(max(places[n, 1], 0.0), rows - 1.0)
        j, i = min(int(x), columns - 2), min(int(y), rows - 2)
        u, v = x - j, y - i
        for c in range(k):
            low = (1 - u) * values[i, j, c] + u * values[i, j + 1, c]
            high = (1 - u) * values[i + 1, j, c] + u * values[i + 1, j + 1, c]
            out[n, c] = (1 - v) * low + v * high
    return out


@njit(cache=True)
def _pair_force(away_x: float, away_y: float, slip_x: float, slip_y: float, touch: float) -> tuple[float, float]:
    """m/s² on a walker from another body at (away_x, away_y) m, walking with (slip_x, slip_y) m/s relative to it; they touch at `touch` m.

    Moussaïd et al. 2009, eq. 3 to 5 with A = 4.5, γ = 0.35, n = 2, n' = 3, λ = 2.
    """
    distance = max(math.hypot(away_x, away_y), 1e-6)
    ex, ey = away_x / distance, away_y / distance
    dx, dy = 2.0 * slip_x + ex, 2.0 * slip_y + ey
    length = math.hypot(dx, dy)
    fx = fy = 0.0
    if length > 1e-6:
        tx, ty = dx / length, dy / length
        theta = math.atan2(tx * ey - ty * ex, tx * ex + ty * ey)
        B = 0.35 * length
        gap = math.exp(-max(distance - touch + 0.4, 0.0) / B)
        slow = 4.5 * gap * math.exp(-((3.0 * B * theta) ** 2))
        turn = 4.5 * gap * math.exp(-((2.0 * B * theta) ** 2)) * (1.0 if theta >= 0 else -1.0)
        fx, fy = -slow * tx + turn * ty, -slow * ty - turn * tx
    push = 25.0 * max(touch + 0.14 - distance, 0.0)
    return fx - push * ex, fy - push * ey


@njit(cache=True)
def _social_force(position: Array, velocity: Array, obstacle: Array, obstacle_velocity: Array, radius: Array) -> Array:
    """(m, 2) m/s² on each walker from all others within 5 m and from all obstacles."""
    m, k = len(position), len(obstacle)
    force = np.zeros((m, 2))
    for i in range(m):
        for j in range(m + k):
            if j == i:
                continue
            if j < m:
                ax, ay, touch = position[j, 0] - position[i, 0], position[j, 1] - position[i, 1], 2 * BODY_RADIUS
                sx, sy = velocity[i, 0] - velocity[j, 0], velocity[i, 1] - velocity[j, 1]
            else:
                o = j - m
                ax, ay, touch = obstacle[o, 0] - position[i, 0], obstacle[o, 1] - position[i, 1], BODY_RADIUS + radius[o]
                sx, sy = velocity[i, 0] - obstacle_velocity[o, 0], velocity[i, 1] - obstacle_velocity[o, 1]
            if ax * ax + ay * ay < 25.0:
                fx, fy = _pair_force(ax, ay, sx, sy, touch)
                force[i, 0] += fx
                force[i, 1] += fy
    return force


@njit(cache=True)
def _apart(position: Array, obstacle: Array, radius: Array) -> Array:
    """position (m, 2) m with bodies that overlap moved apart, half of the way each; from an obstacle, all of it."""
    out = position.copy()
    m = len(out)
    for _ in range(3):
        for i in range(m):
            for j in range(i + 1, m):
                dx, dy = out[j, 0] - out[i, 0], out[j, 1] - out[i, 1]
                distance = max(math.hypot(dx, dy), 1e-6)
                overlap = 2 * BODY_RADIUS - distance
                if overlap > 0:
                    share = 0.5 * overlap / distance
                    out[i, 0] -= share * dx
                    out[i, 1] -= share * dy
                    out[j, 0] += share * dx
                    out[j, 1] += share * dy
            for o in range(len(obstacle)):
                dx, dy = out[i, 0] - obstacle[o, 0], out[i, 1] - obstacle[o, 1]
                distance = max(math.hypot(dx, dy), 1e-6)
                overlap = BODY_RADIUS + radius[o] - distance
                if overlap > 0:
                    out[i, 0] += overlap / distance * dx
                    out[i, 1] += overlap / distance * dy
    return out
