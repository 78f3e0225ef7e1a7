"""Robots that do not know where they start: each keeps itself level, in a frame of its own, until at one tick it sees enough of the team's landmarks
to be placed by them, as one that has lost its way (tracker.slam.relocalization); then it is one of the team.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Protocol

import numpy as np

from tracker.geometry import Array, Pose
from tracker.slam.parameters import SlamParameters
from tracker.slam.relocalization import Known, Place, State, relocalize
from tracker.types import Setup, Sightings, Start, Tick

LEVEL_SIGMA = 0.3
"""rad: what is known of roll and pitch before the first "up" is used; that measurement is taken in by the filter as any other."""
FRAME_SIGMA = 1e-4
"""m and rad: place and heading in one's own frame are so by definition."""


class SingleRobotFilter(Protocol):
    """What is asked of the filter of one robot that waits (slam/filter.py). sighted: camera → sightings of static landmarks at the last tick."""

    sighted: dict[str, Sightings]

    @property
    def state(self) -> State: ...

    def step(self, tick: Tick) -> None: ...

    def pose(self, robot: str) -> Pose: ...


class UnknownStarts:
    """Robots that wait, each with a filter of its own, which `build` makes and which maps nothing."""

    def __init__(self, setup: Setup, parameters: SlamParameters, build: Callable[[Setup, SlamParameters], SingleRobotFilter]) -> None:
        self.setup, self.parameters, self._build = setup, parameters, build
        self._alone: dict[str, SingleRobotFilter] = {}
        self._rule = replace(parameters.search, pairs=parameters.search.strangers)

    def step(self, name: str, tick: Tick, known: Known) -> Place | str:
        """A waiting robot's views of one tick: its place among the team's landmarks, which ends its waiting, or the reason why it waits."""
        if name not in self._alone and not self._begin(name, tick):
            return "no level"
        alone, reason = self._alone[name], "sees nothing"
        # In a frame of its own nobody else is anywhere.
        alone.step(replace(tick, views=tuple(replace(view, companions=None) for view in tick.views)))
        for view in tick.views:
            if view.camera in alone.sighted:
                mount = self.setup.mounts[view.camera]
                found = relocalize(known, (alone.state[0].sight(0, mount), alone.pose(name)), alone.sighted[view.camera], self._rule)
                if isinstance(found, Place):
                    del self._alone[name]
                    return found
                reason = found
        return reason

    def _begin(self, name: str, tick: Tick) -> bool:
        """Put up a filter in a frame of its own: here, heading along x, level by the first "up"."""
        ups = [v.odometry.gravity for v in tick.views if v.odometry is not None and v.odometry.gravity is not None]
        if not ups:
            return False
        mounts = {camera: mount for camera, mount in self.setup.mounts.items() if mount.robot == name}
        setup = replace(self.setup, mounts=mounts, starts={name: level_start(ups[0])})
        self._alone[name] = self._build(setup, replace(self.parameters, growth=0))
        return True


def level_start(up: Array) -> Start:
    """A robot at the origin, heading along x as seen from above, for which the unit direction (3,) in its body is up: roll and pitch are doubted."""
    z = up / np.linalg.norm(up)
    x = np.array([1.0, 0.0, 0.0]) - z[0] * z
    x /= np.linalg.norm(x)
    rotation = np.stack([x, np.cross(z, x), z])
    covariance = np.zeros((6, 6))
    covariance[:3, :3] = np.eye(3) * FRAME_SIGMA**2
    covariance[3:, 3:] = rotation.T @ np.diag(np.square([LEVEL_SIGMA, LEVEL_SIGMA, FRAME_SIGMA])) @ rotation
    return Start(Pose(rotation, np.zeros(3)), covariance)
