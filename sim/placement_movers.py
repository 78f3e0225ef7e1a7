"""What moves robots and people between decisions: kinematics alone, or the wheels of the simulation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from sim import placement_team
from sim.crowd import CrowdState, Obstacles
from sim.placement_config import STEPS, PlacementConfig
from sim.placement_map import PlacementMap
from sim.placement_team import SPEED, YAW, X, Y
from sim.rover import FOOTPRINT_RADIUS
from tracker.geometry import Array, Pose
from tracker.measurements import Odometry
from worlds.heightfield import Mask


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
            self.team, now = placement_team.drive(team, command, self.crowd.position, self.place, self.dt)
            stopped = np.maximum(stopped, now)
        return stopped

    def poses(self) -> list[Pose]:
        return placement_team.poses(self.team, self.place)

    def over(self) -> Mask:
        return np.zeros(len(self.team), dtype=bool)

    def odometry(self) -> None:
        return None
