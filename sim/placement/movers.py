"""The motion of robots and people between decisions: by unicycle kinematics, or by the physics of a Simulation.

Kinematics have limited accelerations, collisions, poses on sloping ground, and energy. The compiled kernels run on one thread in a fixed order.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.crowd.crowd import BehaviorState, CrowdState, StepInput, update_behavior
from sim.crowd.social_force import BODY_RADIUS, SteeringGrid, advance, desired_motion, interactions
from sim.placement.config import DRIVING_STEPS, SPEED, TRAVELLED, TURNED, YAW, YAW_RATE, PlacementConfig, X, Y
from sim.placement.information import NEAR_MISSES, States
from sim.placement.map import PlacementMap, bilinear_at, height_on, kept_with_map
from sim.placement.roadmap import is_free, steer
from sim.robots.driving import ACCELERATION, YAW_ACCELERATION, DriveState, Motion, Route, Traffic, accelerated
from sim.robots.rover import FOOTPRINT_RADIUS, HALF_WIDTH, SPRUNG_MASS, WHEEL_RADIUS, wheel_positions
from sim.scenario import Scenario
from sim.simulation.initial_states import InitialStates
from sim.simulation.simulation import Simulation, Snapshot
from tracker.geometry import Array, Pose
from tracker.geometry.compilation import njit
from tracker.types import Odometry
from worlds.terrain.heightfield import Mask

CONTACT_DISTANCE = HALF_WIDTH + BODY_RADIUS
"""Distance between the centres of a rover and a person in contact, m."""

NEAR_MISS_DISTANCE = CONTACT_DISTANCE + 0.3
"""Distance of a moving rover from a person below which a near miss counts, m."""

MASS = SPRUNG_MASS + 4 * 1.5
"""Mass of a rover, kg."""

ROLLING_RESISTANCE, SCRUBBING_RESISTANCE = 0.05, 0.35
"""Resistance over weight: of rolling wheels, and of wheels that slide sideways while a skid-steered rover turns."""

WHEEL_ARM = 0.38
"""Distance from the centre of a rover to its wheels, m."""

GRAVITY = 9.81
STOPPED_SPEED = 0.05
"""Speed below which a rover counts as stopped while it is commanded more than three times this speed, m/s."""


@njit(cache=True)
def drive_step(team, command, people, space, limits):  # type: ignore[no-untyped-def]
    """The states (r, 7) of rovers a step later, and what stopped each (r,): 1 a person, 2 another rover, 3 the ground, 0 nothing.

    command (r, 2): desired forward speed m/s and yaw rate rad/s. people (p, 2): positions m. space: `Roadmap.grid`.
    limits: greatest changes of speed (m/s) and yaw rate (rad/s) in the step, and its time (s).
    """
    out, stopped = team.copy(), np.zeros(len(team), np.int64)
    for r in range(len(team)):
        for column, limit in ((SPEED, limits[0]), (YAW_RATE, limits[1])):
            desired = command[r, column - SPEED]
            # Braking is at most twice as strong as acceleration.
            brake = 2.0 if abs(desired) < abs(out[r, column]) else 1.0
            out[r, column] += min(max(desired - out[r, column], -brake * limit), brake * limit)
        turn = out[r, YAW_RATE] * limits[2]
        ahead = out[r, SPEED] * limits[2]
        yaw = out[r, YAW] + 0.5 * turn
        x, y = out[r, X] + ahead * math.cos(yaw), out[r, Y] + ahead * math.sin(yaw)
        if not is_free(space, x, y):
            # The rover slides along a wall, as one that steers slightly away would.
            if is_free(space, x, out[r, Y]):
                y = out[r, Y]
            elif is_free(space, out[r, X], y):
                x = out[r, X]
            else:
                stopped[r] = 3
        for q in range(len(team)):
            if q != r and _collides(out[r, X], out[r, Y], x, y, out[q, X], out[q, Y], 2 * HALF_WIDTH):
                stopped[r] = 2
        for p in range(len(people)):
            if _collides(out[r, X], out[r, Y], x, y, people[p, 0], people[p, 1], CONTACT_DISTANCE):
                stopped[r] = 1
        out[r, YAW] = (out[r, YAW] + turn + math.pi) % (2 * math.pi) - math.pi
        out[r, TURNED] += abs(turn)
        if stopped[r]:
            out[r, SPEED] = 0.0
        else:
            out[r, X], out[r, Y] = x, y
            out[r, TRAVELLED] += abs(ahead)
    return out, stopped


@njit(cache=True)
def near_misses(team, people):  # type: ignore[no-untyped-def]
    """The number of people (p, 2) m within NEAR_MISS_DISTANCE of a moving robot of team (r, 7)."""
    count = 0
    for p in range(len(people)):
        for r in range(len(team)):
            if abs(team[r, SPEED]) > 0.1 and (people[p, 0] - team[r, X]) ** 2 + (people[p, 1] - team[r, Y]) ** 2 < NEAR_MISS_DISTANCE**2:
                count += 1
                break
    return count


@njit(cache=True)
def _collides(x0, y0, x1, y1, ox, oy, contact):  # type: ignore[no-untyped-def]
    """Whether a step from (x0, y0) to (x1, y1) m approaches (ox, oy) and ends within `contact` m of it."""
    before, after = (x0 - ox) ** 2 + (y0 - oy) ** 2, (x1 - ox) ** 2 + (y1 - oy) ** 2
    return after < contact * contact and after < before


def poses(team: Array, place: PlacementMap) -> list[Pose]:
    """T_world_robot of rovers (r, 7), on the plane through the ground under their wheels."""
    corners = wheel_positions()[:, :2]
    out = []
    c, s = np.cos(team[:, YAW]), np.sin(team[:, YAW])
    R = np.stack([np.stack([c, -s], axis=1), np.stack([s, c], axis=1)], axis=1)
    under = team[:, None, :2] + np.einsum("rij,wj->rwi", R, corners)
    height = height_on(place.floor, under.reshape(-1, 2)).reshape(-1, 4)
    # The wheels form a rectangle: the differences between opposite sides give the slope of its plane.
    slope_ahead = (height[:, :2].mean(axis=1) - height[:, 2:].mean(axis=1)) / (corners[0, 0] - corners[2, 0])
    slope_left = (height[:, ::2].mean(axis=1) - height[:, 1::2].mean(axis=1)) / (corners[0, 1] - corners[1, 1])
    for k in range(len(team)):
        up = np.array([-slope_ahead[k] * c[k] + slope_left[k] * s[k], -slope_ahead[k] * s[k] - slope_left[k] * c[k], 1.0])
        up /= np.linalg.norm(up)
        x = np.array([c[k], s[k], 0.0]) - (c[k] * up[0] + s[k] * up[1]) * up
        x /= np.linalg.norm(x)
        axes = np.stack([x, np.cross(up, x), up], axis=1)
        out.append(Pose(axes, np.array([*team[k, :2], height[k].mean()]) + WHEEL_RADIUS * up))
    return out


@njit(cache=True)
def camera_kernel(team, heights, origin, spacing, mast):  # type: ignore[no-untyped-def]
    """Camera positions (r, 3) m of rovers (r, 7), `mast` m above the ground along the normal of the slope.

    The ground has heights (rows, columns) m, an origin (2,) m and a spacing, m.
    """
    out = np.empty((len(team), 3))
    for r in range(len(team)):
        x, y, c, s = team[r, X], team[r, Y], math.cos(team[r, YAW]), math.sin(team[r, YAW])
        front = bilinear_at(heights, origin, spacing, x + 0.25 * c, y + 0.25 * s)
        rear = bilinear_at(heights, origin, spacing, x - 0.25 * c, y - 0.25 * s)
        left = bilinear_at(heights, origin, spacing, x - 0.28 * s, y + 0.28 * c)
        right = bilinear_at(heights, origin, spacing, x + 0.28 * s, y - 0.28 * c)
        ahead, aside = (front - rear) / 0.5, (left - right) / 0.56
        up = 1.0 / math.sqrt(1.0 + ahead * ahead + aside * aside)
        out[r, 0] = x - mast * up * (ahead * c - aside * s)
        out[r, 1] = y - mast * up * (ahead * s + aside * c)
        out[r, 2] = 0.25 * (front + rear + left + right) + mast * up
    return out


@njit(cache=True)
def energy(before, after, climbed):  # type: ignore[no-untyped-def]
    """Energy in kJ that a team spent between two states (r, 7): rolling, scrubbing, and climbing by climbed (r,) m.

    Descending recovers no energy.
    """
    work = 0.0
    for r in range(len(after)):
        rolled, turned = after[r, TRAVELLED] - before[r, TRAVELLED], after[r, TURNED] - before[r, TURNED]
        work += ROLLING_RESISTANCE * rolled + SCRUBBING_RESISTANCE * WHEEL_ARM * turned + max(climbed[r], 0.0)
    return MASS * GRAVITY * work / 1000.0


class Order(NamedTuple):
    """Commands of n episodes: velocity (n, r, 2) m/s, rad/s, or goals (n, r), nodes of the roadmap; (n, 0) for velocity commands."""

    velocity: Array
    goals: NDArray[np.int64]


class Ways(NamedTuple):
    """The constants of a map for the motion of robots and people.

    grid, groups, behavior: of the crowd. graph: nodes (n, 2) m and next_node (n, n) of the roadmap. space: `Roadmap.grid`.
    """

    grid: SteeringGrid
    groups: tuple[NDArray[np.int64], Array]
    behavior: BehaviorState
    graph: tuple[Array, NDArray[np.int32]]
    space: tuple[Mask, Array, float]


@dataclass(eq=False)
class KinematicMover:
    """Rovers with unicycle kinematics, among people who avoid them. `advance` changes row `row` of states. dt: of a frame, s."""

    place: PlacementMap
    states: States
    row: int
    dt: float

    @staticmethod
    def begin(config: PlacementConfig, place: PlacementMap, starts: Array, crowd: CrowdState) -> KinematicMover:
        states = States.begun(config, 1, crowd.body.shape[1])
        states.team[0, :, [X, Y, YAW]] = starts.T
        states.body[0] = crowd.body
        return KinematicMover(place, states, 0, config.frame_period)

    @property
    def team(self) -> Array:
        """States of the rovers (r, 7), in the columns of config.py."""
        return self.states.team[self.row]

    @property
    def crowd(self) -> CrowdState:
        """The people."""
        return CrowdState(self.states.body[self.row], float(self.states.time[self.row]), len(self.states.body[self.row]))

    def advance(self, order: Order) -> None:
        """Advance by a frame."""
        advance_rows(np.array([self.row]), self.states, order, ways_of(self.place), (self.dt, 1))

    def poses(self) -> list[Pose]:
        """T_world_robot of all robots."""
        return poses(self.team, self.place)

    def tipped(self) -> Mask:
        """Whether each robot has tipped over (r,)."""
        return np.zeros(len(self.team), dtype=bool)

    def odometry(self) -> list[Odometry] | None:
        """Odometry of the last frame from wheels and gyroscopes, or None where they are not simulated."""
        return None


@kept_with_map
def ways_of(place: PlacementMap) -> Ways:
    """The ways of a map, cached."""
    grid, groups, behavior = place.crowd.constants()
    return Ways(grid, groups, behavior, (place.roadmap.nodes, place.roadmap.next_node), place.roadmap.grid)


@njit(cache=True, nogil=True)
def advance_rows(rows, states, order, ways, times):  # type: ignore[no-untyped-def]
    """Advance the episodes `rows` (n,) of one map, in place. order: commands of each. times: of a frame, s, and number of frames."""
    for n in range(len(rows)):
        _advance(rows[n], states, Order(order.velocity[n], order.goals[n]), ways, times)


@njit(cache=True)
def _advance(row, states, order, ways, times):  # type: ignore[no-untyped-def]
    (dt, frames), team, body = times, states.team[row], states.body[row]
    command, obstacle = order.velocity, np.zeros((len(team), 7))
    obstacle[:, 4] = FOOTPRINT_RADIUS
    for _ in range(frames):
        if len(order.goals):
            command = steer(team, order.goals, body[:, :2], ways.graph, ways.space)
        if len(body):
            for r in range(len(team)):
                c, s = math.cos(team[r, YAW]) * team[r, SPEED], math.sin(team[r, YAW]) * team[r, SPEED]
                obstacle[r, 0], obstacle[r, 1], obstacle[r, 2], obstacle[r, 3] = team[r, X], team[r, Y], c, s
            desired, _ = desired_motion(body, ways.grid, ways.groups)
            effect, pairs = interactions(body, desired, obstacle)
            body = advance(body, desired, (effect, pairs), obstacle, ways.grid, dt)
            update_behavior(body, (desired, effect, obstacle), ways.grid.goals, ways.behavior, StepInput(states.time[row], dt, len(body), 0))
        states.time[row] += dt
        for _ in range(DRIVING_STEPS):
            part = dt / DRIVING_STEPS
            team, now = drive_step(team, command, body[:, :2], ways.space, (ACCELERATION * part, YAW_ACCELERATION * part, part))
            states.stopped[row] = np.maximum(states.stopped[row], now)
        states.terms[row, NEAR_MISSES] = max(states.terms[row, NEAR_MISSES], near_misses(team, body[:, :2]))
    states.team[row], states.body[row] = team, body


@dataclass
class VelocityDriver:
    """A rover's driver that follows a velocity command within the limits of acceleration. speed m/s, yaw_rate rad/s: the command."""

    speed: float = 0.0
    yaw_rate: float = 0.0

    def start(self, position: Array) -> DriveState:
        return DriveState(Route.through(np.stack([position, position])), 0.0, 0, 0.0, 0.0, 0.0, 0.0)

    def step(self, drive: DriveState, motion: Motion, traffic: Traffic, dt: float) -> DriveState:
        return accelerated(drive, self.speed, self.yaw_rate, dt)


class PhysicsMover:
    """Rovers on simulated wheels in a Simulation, with the methods of KinematicMover. A pickle holds the configuration and a snapshot."""

    def __init__(self, config: PlacementConfig, place: PlacementMap, starts: Array, crowd: CrowdState) -> None:
        self.config, self.place, self._initial = config, place, (starts, crowd)
        self.states, self.row = States.begun(config, 1, crowd.body.shape[1]), 0
        self._simulate()
        self.states.team[0, :, :5], self.states.body[0] = self.simulation.motions(), crowd.body

    @property
    def team(self) -> Array:
        """As KinematicMover.team."""
        return self.states.team[self.row]

    def _simulate(self) -> None:
        config, key = self.config, self.place.key
        scenario = Scenario(
            world=key.world,
            difficulty=key.difficulty,
            seed=key.seed,
            robots=config.robots,
            people=config.people,
            rate=1.0 / config.frame_period,
            camera_height=config.camera_height,
        )
        robots, people = self._initial
        self._velocity_drivers = tuple(VelocityDriver() for _ in robots)
        self.simulation = Simulation(scenario, self.place.world, start=InitialStates(robots, self._velocity_drivers, people, self.place.crowd))

    @property
    def crowd(self) -> CrowdState:
        return self.simulation.crowd_state

    def advance(self, order: Order) -> None:
        """As KinematicMover.advance."""
        states, row, command, before = self.states, self.row, order.velocity[0], self.team.copy()
        if order.goals.size:
            ways = ways_of(self.place)
            command = steer(before, order.goals[0], self.crowd.position, ways.graph, ways.space)
        for driver, (speed, yaw_rate) in zip(self._velocity_drivers, command, strict=True):
            driver.speed, driver.yaw_rate = float(speed), float(yaw_rate)
        self.simulation.step()
        now = self.simulation.motions()
        states.team[row, :, :5], states.body[row] = now, self.crowd.body
        states.team[row, :, 5] += np.hypot(*(now[:, :2] - before[:, :2]).T)
        states.team[row, :, 6] += np.abs(now[:, 4]) * self.config.frame_period
        states.stopped[row] = np.maximum(states.stopped[row], self._stopped(command))
        states.terms[row, NEAR_MISSES] = max(states.terms[row, NEAR_MISSES], near_misses(self.team, self.crowd.position))

    def _stopped(self, command: Array) -> NDArray[np.int64]:
        """What stopped each rover (r,): 1 near a person, 2 near another rover, 3 elsewhere; 0 for rovers that move or have no command."""
        blocked = (np.abs(command[:, 0]) > 3 * STOPPED_SPEED) & (np.abs(self.team[:, 3]) < STOPPED_SPEED) & (np.abs(self.team[:, 4]) < STOPPED_SPEED)
        place = self.team[:, :2]
        people = np.linalg.norm(place[:, None] - self.crowd.position, axis=2).min(axis=1, initial=np.inf)
        between = np.linalg.norm(place[:, None] - place, axis=2) + 1e9 * np.eye(len(place))
        cause = np.where(people < NEAR_MISS_DISTANCE, 1, np.where(between.min(axis=1) < 2 * HALF_WIDTH + 0.3, 2, 3))
        return np.where(blocked, cause, 0)

    def poses(self) -> list[Pose]:
        return [self.simulation.T_world_robot(name) for name in self.simulation.robots]

    def tipped(self) -> Mask:
        return np.array(list(self.simulation.tipped().values()))

    def odometry(self) -> list[Odometry] | None:
        found = self.simulation.odometry()
        return [found[name] for name in self.simulation.robots] if found else None

    def __getstate__(self) -> dict[str, Any]:
        return {"configuration": (self.config, self.place, self._initial), "states": (self.states, self.row), "snapshot": self.simulation.save()}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.config, self.place, self._initial = state["configuration"]
        self.states, self.row = state["states"]
        self._simulate()
        snapshot: Snapshot = state["snapshot"]
        self.simulation.restore(snapshot)


Mover = KinematicMover | PhysicsMover
"""The motion of robots and people."""
