"""What moves robots and people between decisions: kinematics alone, or the wheels of the simulation.

Robots on wheels: the simulation with its rovers told where to go, among the people of a map.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np

from sim.crowd.crowd import CrowdState, Obstacles
from sim.placement import kinematics
from sim.placement.config import SPEED, STEPS, YAW, PlacementConfig, X, Y
from sim.placement.kinematics import NEAR, TOUCH
from sim.placement.map import PlacementMap
from sim.robots.driving import ACCELERATION, YAW_ACCELERATION, DriveState, Motion, Route, Traffic
from sim.robots.rover import FOOTPRINT_RADIUS, HALF_WIDTH
from sim.scenario import Scenario
from sim.simulation.initial_states import InitialStates
from sim.simulation.simulation import Simulation, Snapshot
from tracker.geometry import Array, Pose
from tracker.types import Odometry
from worlds.terrain.heightfield import Mask


class Mover(Protocol):
    """Moves robots and people on; team (r, 7) in the columns of placement_team, and the people as they are now."""

    @property
    def team(self) -> Array: ...

    @property
    def crowd(self) -> CrowdState: ...

    def advance(self, command: Array) -> Array:
        """A frame later, the robots told to go at command (r, 2) m/s, rad/s; (r,) who was stopped, as placement_team.drive tells it."""
        ...

    def poses(self) -> list[Pose]:
        """T_world_robot of all robots."""
        ...

    def over(self) -> Mask:
        """(r,) whether each robot has tipped over."""
        ...

    def odometry(self) -> list[Odometry] | None:
        """What wheels and gyroscopes say of the last frame; None where they are not simulated."""
        ...


@dataclass(eq=False)
class Kinematic:
    """Rovers without dynamics among people who walk around them; dt s a step."""

    place: PlacementMap
    team: Array
    crowd: CrowdState
    dt: float

    @staticmethod
    def begin(config: PlacementConfig, place: PlacementMap, starts: Array, crowd: CrowdState) -> Kinematic:
        team = np.zeros((len(starts), 7))
        team[:, [X, Y, YAW]] = starts
        return Kinematic(place, team, crowd, config.frame / STEPS)

    def advance(self, command: Array) -> Array:
        stopped, radius = np.zeros(len(self.team)), np.full(len(self.team), FOOTPRINT_RADIUS)
        for _ in range(STEPS):
            team = self.team
            if len(self.crowd.body):
                ahead = np.empty((len(team), 2))
                ahead[:, 0], ahead[:, 1] = np.cos(team[:, YAW]) * team[:, SPEED], np.sin(team[:, YAW]) * team[:, SPEED]
                self.crowd = self.place.crowd.step(self.crowd, Obstacles(team[:, :2], ahead, radius), self.dt)
            self.team, now = kinematics.drive(team, command, self.crowd.position, self.place, self.dt)
            stopped = np.maximum(stopped, now)
        return stopped

    def poses(self) -> list[Pose]:
        return kinematics.poses(self.team, self.place)

    def over(self) -> Mask:
        return np.zeros(len(self.team), dtype=bool)

    def odometry(self) -> None:
        return None


BLOCKED = 0.05
"""m/s: a rover that is told to go faster than three times this and is slower is stopped."""


@dataclass
class Remote:
    """A rover's driver that does as it is told, as fast as its accelerations allow: speed m/s, yaw_rate rad/s."""

    speed: float = 0.0
    yaw_rate: float = 0.0

    def start(self, position: Array) -> DriveState:
        return DriveState(Route.through(np.stack([position, position])), 0.0, 0, 0.0, 0.0, 0.0, 0.0)

    def step(self, drive: DriveState, motion: Motion, traffic: Traffic, dt: float) -> DriveState:
        dv, dw = ACCELERATION * dt, YAW_ACCELERATION * dt
        brake = 2.0 if abs(self.speed) < abs(drive.speed) else 1.0
        speed = drive.speed + float(np.clip(self.speed - drive.speed, -brake * dv, brake * dv))
        return replace(drive, speed=speed, yaw_rate=drive.yaw_rate + float(np.clip(self.yaw_rate - drive.yaw_rate, -dw, dw)))


class Physical:
    """As movers.Mover, by the simulation. A pickle holds the scenario and a snapshot."""

    def __init__(self, config: PlacementConfig, place: PlacementMap, begin: tuple[Array, CrowdState]) -> None:
        self.config, self.place, self._begin = config, place, begin
        self._simulate()
        self.team = np.column_stack([self.simulation.motions(), np.zeros((config.robots, 2))])

    @staticmethod
    def begin(config: PlacementConfig, place: PlacementMap, starts: Array, crowd: CrowdState) -> Physical:
        return Physical(config, place, (starts, crowd))

    def _simulate(self) -> None:
        c, key = self.config, self.place.key
        size: dict[str, Any] = {"robots": c.robots, "people": c.people, "rate": 1.0 / c.frame, "camera_height": c.camera_height}
        scenario = Scenario(world=key.world, difficulty=key.difficulty, seed=key.seed, **size)
        robots, people = self._begin
        self._remotes = tuple(Remote() for _ in robots)
        self.simulation = Simulation(scenario, self.place.world, start=InitialStates(robots, self._remotes, people, self.place.crowd))

    @property
    def crowd(self) -> CrowdState:
        return self.simulation.crowd_state

    def advance(self, command: Array) -> Array:
        for remote, (speed, yaw_rate) in zip(self._remotes, command, strict=True):
            remote.speed, remote.yaw_rate = float(speed), float(yaw_rate)
        self.simulation.step()
        now = self.simulation.motions()
        gone = np.hypot(*(now[:, :2] - self.team[:, :2]).T)
        turned = np.abs(now[:, 4]) * self.config.frame
        self.team = np.column_stack([now, self.team[:, 5] + gone, self.team[:, 6] + turned])
        return self._stopped(command)

    def _stopped(self, command: Array) -> Array:
        """(r,) 1 beside a person, 2 beside another rover, 3 elsewhere, where a rover that is told to go does not; 0 for the others."""
        held = (np.abs(command[:, 0]) > 3 * BLOCKED) & (np.abs(self.team[:, 3]) < BLOCKED) & (np.abs(self.team[:, 4]) < BLOCKED)
        place = self.team[:, :2]
        people = np.linalg.norm(place[:, None] - self.crowd.position, axis=2).min(axis=1, initial=np.inf)
        between = np.linalg.norm(place[:, None] - place, axis=2) + 1e9 * np.eye(len(place))
        beside = np.where(people < max(TOUCH, NEAR), 1, np.where(between.min(axis=1) < 2 * HALF_WIDTH + 0.3, 2, 3))
        return np.where(held, beside, 0)

    def poses(self) -> list[Pose]:
        return [self.simulation.T_world_robot(name) for name in self.simulation.robots]

    def over(self) -> Mask:
        return np.array(list(self.simulation.tipped().values()))

    def odometry(self) -> list[Odometry] | None:
        found = self.simulation.odometry()
        return [found[name] for name in self.simulation.robots] if found else None

    def __getstate__(self) -> dict[str, Any]:
        return {"of": (self.config, self.place, self._begin), "team": self.team, "snapshot": self.simulation.save()}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.config, self.place, self._begin = state["of"]
        self.team = state["team"]
        self._simulate()
        snapshot: Snapshot = state["snapshot"]
        self.simulation.restore(snapshot)
