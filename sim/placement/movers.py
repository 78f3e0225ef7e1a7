"""The motion of robots and people between decisions: by unicycle kinematics, or by the physics of a Simulation."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.crowd.behavior import BehaviorState, StepInput, update_behavior
from sim.crowd.crowd import CrowdState
from sim.crowd.social_force import SteeringGrid, advance, desired_motion, interactions
from sim.placement import kinematics
from sim.placement.config import DRIVING_STEPS, SPEED, YAW, PlacementConfig, X, Y
from sim.placement.kinematics import CONTACT_DISTANCE, NEAR_MISS_DISTANCE, drive_step, near_misses
from sim.placement.map import CACHED_MAPS, PlacementMap
from sim.placement.roadmap import steer
from sim.placement.states import NEAR_MISSES, States
from sim.robots.driving import ACCELERATION, YAW_ACCELERATION, DriveState, Motion, Route, Traffic
from sim.robots.rover import FOOTPRINT_RADIUS, HALF_WIDTH
from sim.scenario import Scenario
from sim.simulation.initial_states import InitialStates
from sim.simulation.simulation import Simulation, Snapshot
from tracker.geometry import Array, Pose
from tracker.geometry.compilation import njit
from tracker.types import Odometry
from worlds.terrain.heightfield import Mask

STOPPED_SPEED = 0.05
"""Speed below which a rover counts as stopped while it is commanded more than three times this speed, m/s."""


class Order(NamedTuple):
    """What robots of n episodes shall do: velocity (n, r, 2) m/s, rad/s, or goals (n, r), nodes of the roadmap; (n, 0) for none."""

    velocity: Array
    goals: NDArray[np.int64]


class Ways(NamedTuple):
    """What robots and people move on.

    grid, groups, behavior: of the crowd. graph: nodes (n, 2) m and next_node (n, n) of the roadmap. space: `Roadmap.grid`.
    """

    grid: SteeringGrid
    groups: tuple[NDArray[np.int64], Array]
    behavior: BehaviorState
    graph: tuple[Array, NDArray[np.int32]]
    space: tuple[Mask, Array, float]


@dataclass(eq=False)
class KinematicMover:
    """Rovers by unicycle kinematics, among people who walk around them: those of row `row` of states, which advance changes. dt: of a frame, s."""

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
        return kinematics.poses(self.team, self.place)

    def tipped(self) -> Mask:
        """Whether each robot has tipped over (r,)."""
        return np.zeros(len(self.team), dtype=bool)

    def odometry(self) -> list[Odometry] | None:
        """Odometry of the last frame from wheels and gyroscopes, or None where they are not simulated."""
        return None


@lru_cache(maxsize=CACHED_MAPS)
def ways_of(place: PlacementMap) -> Ways:
    """The ways of a map, cached."""
    grid, groups, behavior = place.crowd.constants()
    return Ways(grid, groups, behavior, (place.roadmap.nodes, place.roadmap.next_node), place.roadmap.grid)


@njit(cache=True, nogil=True)
def advance_rows(rows, states, order, ways, times):  # type: ignore[no-untyped-def]
    """Advance the episodes `rows` (n,) of one map, in place. order: of each. times: of a frame, s, and number of frames."""
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
        dv, dw = ACCELERATION * dt, YAW_ACCELERATION * dt
        brake = 2.0 if abs(self.speed) < abs(drive.speed) else 1.0
        speed = drive.speed + float(np.clip(self.speed - drive.speed, -brake * dv, brake * dv))
        return replace(drive, speed=speed, yaw_rate=drive.yaw_rate + float(np.clip(self.yaw_rate - drive.yaw_rate, -dw, dw)))


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
        cause = np.where(people < max(CONTACT_DISTANCE, NEAR_MISS_DISTANCE), 1, np.where(between.min(axis=1) < 2 * HALF_WIDTH + 0.3, 2, 3))
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
