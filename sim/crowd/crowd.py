"""Crowd simulation: people walk to their goals, alone or in groups, around each other, walls and robots.

One step has interactions and motion (social_force.py), and behaviour: arrival, pauses, change of goals, entering and leaving.
Its kernels are compiled, single-threaded, in a fixed order. Plans are drawn in goals.py.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from sim.crowd.goals import GoalPlans, Postures
from sim.crowd.social_force import (
    GOAL,
    HEADING,
    HEADWAY_SPEED,
    PAUSE,
    PRESENT,
    SPEED,
    STUCK,
    VISIT,
    VX,
    VY,
    YIELDS,
    Number,
    Numbers,
    SteeringGrid,
    X,
    Y,
    advance,
    desired_motion,
    interactions,
)
from sim.pedestrian.gait import Terrain
from tracker.geometry import Array, frozen
from tracker.geometry.compilation import njit
from worlds.terrain.free_space import FreeSpace

ARRIVED = 0.7
"""m: distance at which a goal counts as reached; 2.5 times as far for somebody who is blocked."""
PATIENCE = 6.0
"""s without progress after which a person takes the next goal. Time in a queue counts a quarter."""
GROUP_RANGE = 1.6
"""m: distance to the leader of a group within which the others pause with the leader."""
COLUMNS = GOAL + 1


class BehaviorState(NamedTuple):
    """The arrays of goals.GoalPlans for compiled functions."""

    itinerary: Numbers
    group: Numbers
    exit: Numbers
    speed: Array
    pauses: Array
    entry: Array
    leave: Array


class StepInput(NamedTuple):
    """Time and length of a step, s; how many people have entered so far, and how many may be present at once (0: all)."""

    time: float
    dt: float
    entered: int
    at_once: int


@njit(cache=True)
def update_behavior(body: Array, inputs: tuple[Array, Array, Array], goals: Array, plans: BehaviorState, step_input: StepInput) -> int:
    """Update goals, pauses and presence of bodies (m, 10) after a step, in place. Returns how many people have entered by then.

    inputs: desired motion (m, 6), interactions (m, 5) and obstacles (k, 7), as in social_force. goals: (g, 2) m.
    """
    present = np.flatnonzero(body[:, PRESENT] > 0)
    for i in present:
        _update_goal(body, i, (inputs[0][i], inputs[1][i]), goals, plans, step_input.dt)
    _exit_people(body, present, goals, plans, step_input.time)
    return _enter_people(body, inputs[2], plans, step_input)


@njit(cache=True)
def _update_goal(out: Array, i: Number, inputs: tuple[Array, Array], goals: Array, plans: BehaviorState, dt: float) -> None:
    """Arrival, impatience and next goal of body i after a step of dt s. Members of a group copy the first of them who is present."""
    desired, effect = inputs
    if math.hypot(out[i, VX], out[i, VY]) >= 0.25 * desired[SPEED] + 0.05:
        out[i, STUCK] = 0.0
    elif effect[YIELDS] > 0 or effect[HEADWAY_SPEED] < 0.5 * desired[SPEED]:
        # Whole multiples of 0.05 s, although steps of sequences differ a little from it: sequences stay the same.
        out[i, STUCK] -= 0.75 * min(out[i, STUCK], 0.05 * max(1, round(dt / 0.05)))
    goal = int(out[i, GOAL])
    if plans.leave[i] < np.inf and goal == plans.exit[i]:
        return
    k = plans.itinerary.shape[1]
    distance = math.hypot(goals[goal, 0] - out[i, X], goals[goal, 1] - out[i, Y])
    there = distance < ARRIVED or (distance < 2.5 * ARRIVED and out[i, STUCK] > 0.5)
    leader = plans.group[i]
    while leader < i and out[leader, PRESENT] <= 0:
        leader += 1
    if leader < i:
        near = math.hypot(out[leader, X] - out[i, X], out[leader, Y] - out[i, Y]) < GROUP_RANGE
        out[i, PAUSE] = out[leader, PAUSE] if near or there else 0.0
        out[i, VISIT] = out[leader, VISIT]
    elif there and out[i, PAUSE] <= 0 and desired[SPEED] > 0:
        out[i, PAUSE] = max(plans.pauses[i, int(out[i, VISIT]) % k], 1e-6)
    elif out[i, STUCK] > PATIENCE:
        out[i, STUCK] = 0.0
        out[i, VISIT] += 1
    out[i, GOAL] = plans.itinerary[i, int(out[i, VISIT]) % k]


@njit(cache=True)
def _exit_people(out: Array, present: Numbers, goals: Array, plans: BehaviorState, time: float) -> None:
    """Send people whose time is over to their exits, and remove those who have reached them."""
    for i in present:
        if plans.leave[i] == np.inf:
            continue
        exit_ = plans.exit[i]
        distance = math.hypot(goals[exit_, 0] - out[i, X], goals[exit_, 1] - out[i, Y])
        if int(out[i, GOAL]) != exit_:
            if time + 1.3 * distance / plans.speed[i] >= plans.leave[i]:
                out[i, GOAL], out[i, PAUSE] = exit_, 0.0
        elif distance < ARRIVED or (distance < 2.5 * ARRIVED and out[i, STUCK] > 1.0):
            out[i, PRESENT] = out[i, VX] = out[i, VY] = 0.0


@njit(cache=True)
def _enter_people(out: Array, obstacle: Array, plans: BehaviorState, step_input: StepInput) -> int:
    """Let the next person enter if an entry is free: the person's own, or that of one of the next seven people. Returns how many have entered."""
    entered, at_once, m = step_input.entered, step_input.at_once, len(out)
    if at_once == 0 or entered >= m or (out[:, PRESENT] > 0).sum() >= at_once:
        return entered
    for a in range(8):
        x, y = plans.entry[(entered + a) % m]
        free = True
        for i in range(m):
            free = free and (out[i, PRESENT] <= 0 or math.hypot(out[i, X] - x, out[i, Y] - y) > 0.7)
        for o in range(len(obstacle)):
            free = free and math.hypot(obstacle[o, 0] - x, obstacle[o, 1] - y) > obstacle[o, 4] + 0.6
        if free:
            out[entered, X], out[entered, Y], out[entered, PRESENT] = x, y, 1.0
            return entered + 1
    return entered


@dataclass(frozen=True, eq=False)
class CrowdState:
    """State of m people: body (m, 10) with the columns of social_force.py; time s; entered: how many have entered so far, in order."""

    body: Array
    time: float
    entered: int

    def __post_init__(self) -> None:
        object.__setattr__(self, "body", frozen(self.body, (None, COLUMNS), "body"))

    @property
    def position(self) -> Array:
        """(m, 2) m."""
        return self.body[:, X : X + 2]

    @property
    def velocity(self) -> Array:
        """(m, 2) m/s."""
        return self.body[:, VX : VX + 2]

    @property
    def heading(self) -> Array:
        """(m,) rad."""
        return self.body[:, HEADING]

    @property
    def present(self) -> NDArray[np.bool_]:
        """(m,) bool: who is present. The others have not entered yet or have left."""
        return self.body[:, PRESENT] > 0


@dataclass(frozen=True, eq=False)
class Obstacles:
    """Moving discs that people avoid: position (k, 2) m, velocity (k, 2) m/s, radius (k,) m.

    requested_velocity (k, 2) m/s: how each would move if people gave way; 0 for no request. None: no requests at all.
    """

    position: Array
    velocity: Array
    radius: Array
    requested_velocity: Array | None = None

    @staticmethod
    def none() -> Obstacles:
        return Obstacles(np.zeros((0, 2)), np.zeros((0, 2)), np.zeros(0))

    @cached_property
    def packed(self) -> Array:
        """(k, 7): x, y, vx, vy, radius, requested vx, vy."""
        requested_velocity = np.zeros_like(self.velocity) if self.requested_velocity is None else self.requested_velocity
        return np.column_stack([self.position, self.velocity, self.radius, requested_velocity]).astype(np.float64)


class PedestrianModel(Protocol):
    """A model of moving people: a Crowd with its own plans, or a Replay of given paths."""

    def step(self, state: CrowdState, obstacles: Obstacles, dt: float) -> CrowdState: ...


@dataclass(frozen=True, eq=False)
class Crowd:
    """A crowd in one world. It holds the constants; `step` returns the next state. postures: who sits and who talks; None for nobody."""

    free_space: FreeSpace
    ground: Terrain
    plans: GoalPlans
    postures: Postures | None = None
    _known: set[int] = field(default_factory=set, init=False, repr=False)

    def start(self, position: Array, heading: Array, robots: Array | None = None) -> CrowdState:
        """State of people at position (m, 2) m with heading (m,) rad. If people come and go, the first plans.at_once are present.

        Sitters and talking groups are elsewhere: on their seats, and in circles clear of robots (r, 2) m.
        """
        m = len(position)
        body = np.zeros((m, COLUMNS))
        entered = self.plans.at_once or m
        body[:, X : X + 2] = position
        body[entered:, X : X + 2] = self.plans.entry[entered:]
        body[:, HEADING] = heading
        body[:entered, PRESENT] = 1.0
        body[:, GOAL] = self.plans.itinerary[:, 0] if m else 0.0
        if self.postures is not None:
            self.postures.placed(body, self.plans, self.free_space, np.zeros((0, 2)) if robots is None else robots)
        return CrowdState(body, 0.0, entered)

    def step(self, state: CrowdState, obstacles: Obstacles, dt: float) -> CrowdState:
        """The state `dt` s later."""
        if not len(state.body):
            return state
        grid, packed = self._grid, obstacles.packed
        desired, unknown = desired_motion(state.body, grid, self._groups)
        if unknown:
            self._compute_directions(state.body[state.present, GOAL])
            desired, unknown = desired_motion(state.body, grid, self._groups)
        effect, close_pairs = interactions(state.body, desired, packed)
        body = advance(state.body, desired, (effect, close_pairs), packed, grid, dt)
        entered = update_behavior(
            body, (desired, effect, packed), grid.goals, self._behavior, StepInput(state.time, dt, state.entered, self.plans.at_once)
        )
        if self.postures is not None:
            self.postures.kept(state.body, body, self.free_space, packed, dt)
        return CrowdState(body, state.time + dt, entered)

    def constants(self) -> tuple[SteeringGrid, tuple[NDArray[np.int64], Array], BehaviorState]:
        """Arguments of compiled steps of this crowd, with the directions to all goals: the grid, groups with speeds, and plans."""
        self._compute_directions(np.arange(len(self.plans.goals), dtype=np.float64))
        return self._grid, self._groups, self._behavior

    def _compute_directions(self, goals: Array) -> None:
        for number in map(int, np.unique(goals)):
            if number not in self._known:
                direction = self.free_space.direction_at(self.free_space.distance_to(self.plans.goals[number]), self._nodes)
                self._grid.directions[number] = direction.reshape(*self.free_space.free.shape, 2)
                self._grid.known[number] = True
                self._known.add(number)

    @property
    def _nodes(self) -> Array:
        """(rows · columns, 2) m: the grid points of free space."""
        return self.free_space.points(np.ones_like(self.free_space.free))

    @cached_property
    def _grid(self) -> SteeringGrid:
        nodes, shape = self._nodes, self.free_space.free.shape
        maps = np.column_stack([self.free_space.clearance_at(nodes), self.free_space.away_at(nodes), self.ground.height_at(nodes)])
        count = len(self.plans.goals)
        # Directions are filled in on demand. Until then the pages of this array take no memory.
        directions, known = np.zeros((count, *shape, 2), dtype=np.float32), np.zeros(count, dtype=np.bool_)
        frame = np.array([*self.free_space.origin, self.free_space.spacing])
        return SteeringGrid(
            maps.reshape(*shape, 4).astype(np.float32), directions, known, np.ascontiguousarray(self.plans.goals, dtype=np.float64), frame
        )

    @cached_property
    def _behavior(self) -> BehaviorState:
        p = self.plans
        itinerary, group, leaving = (np.ascontiguousarray(a, dtype=np.int64) for a in (p.itinerary, p.group, p.exit))
        speed, pauses, entry, leave = (np.ascontiguousarray(a, dtype=np.float64) for a in (p.speed, p.pauses, p.entry, p.leave))
        return BehaviorState(itinerary, group, leaving, speed, pauses, entry, leave)

    @cached_property
    def _groups(self) -> tuple[NDArray[np.int64], Array]:
        return self._behavior.group, self._behavior.speed
