"""Robots on wheels: the simulation with its rovers told where to go, among the people of a map."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sim.crowd import CrowdState
from sim.driving import ACCELERATION, YAW_ACCELERATION, Drive, Motion, Route, Traffic
from sim.placement_config import PlacementConfig
from sim.placement_map import PlacementMap
from sim.placement_team import NEAR, TOUCH
from sim.rover import HALF_WIDTH
from sim.scenario import Scenario
from sim.simulation import Simulation, Snapshot
from sim.starts import Start
from tracker.geometry import Array, Pose
from tracker.measurements import Odometry
from worlds.heightfield import Mask

BLOCKED = 0.05
"""m/s: a rover that is told to go faster than three times this and is slower is stopped."""


@dataclass
class Remote:
    """A rover's driver that does as it is told, as fast as its accelerations allow: speed m/s, yaw_rate rad/s."""

    speed: float = 0.0
    yaw_rate: float = 0.0

    def start(self, position: Array) -> Drive:
        return Drive(Route.through(np.stack([position, position])), 0.0, 0, 0.0, 0.0, 0.0, 0.0)

    def step(self, drive: Drive, motion: Motion, traffic: Traffic, dt: float) -> Drive:
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
        self.simulation = Simulation(scenario, self.place.world, start=Start(robots, self._remotes, people, self.place.crowd))

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
