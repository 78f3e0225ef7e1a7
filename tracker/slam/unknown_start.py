"""Robots with an unknown initial pose: they wait in a frame of their own until they can be relocalized in the team's map.

Each waiting robot has a filter that keeps it level. It joins the team at the first tick at which relocalization succeeds (relocalization.py).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Protocol

import numpy as np

from tracker.geometry import Array, Pose
from tracker.slam.parameters import SlamParameters
from tracker.slam.relocalization import KnownLandmarks, RelocalizedPose, SlamState, relocalize
from tracker.types import Setup, Sightings, Start, Tick

LEVEL_SIGMA = 0.3
"""rad: standard deviation of roll and pitch before the first measured "up", which the filter then uses as any other measurement."""
FRAME_SIGMA = 1e-4
"""m and rad: standard deviation of position and heading, which are exact by the definition of the frame."""


class SingleRobotFilter(Protocol):
    """The interface of the filter of one waiting robot (filter.py). sighted: camera → static sightings of the last tick."""

    sighted: dict[str, Sightings]

    @property
    def state(self) -> SlamState: ...

    def step(self, tick: Tick) -> None: ...

    def pose(self, robot: str) -> Pose: ...


class UnknownStarts:
    """The waiting robots, each with a filter made by `build` that adds no landmarks."""

    def __init__(self, setup: Setup, parameters: SlamParameters, build: Callable[[Setup, SlamParameters], SingleRobotFilter]) -> None:
        self.setup, self.parameters, self._build = setup, parameters, build
        self._filters: dict[str, SingleRobotFilter] = {}
        self._relocalization = replace(parameters.relocalization, min_inliers=parameters.relocalization.min_inliers_unknown_start)

    def step(self, name: str, tick: Tick, known: KnownLandmarks) -> RelocalizedPose | str:
        """Process the views of a waiting robot at one tick.

        Returns its pose among the team's landmarks, which ends its waiting, or the reason of failure.
        """
        if name not in self._filters and not self._start_filter(name, tick):
            return "no level"
        single, reason = self._filters[name], "sees nothing"
        # The poses of other robots are unknown in this frame.
        single.step(replace(tick, views=tuple(replace(view, robot_detections=None) for view in tick.views)))
        for view in tick.views:
            if view.camera in single.sighted:
                mount = self.setup.mounts[view.camera]
                found = relocalize(
                    known, (single.state[0].camera_pose(0, mount), single.pose(name)), single.sighted[view.camera], self._relocalization
                )
                if isinstance(found, RelocalizedPose):
                    del self._filters[name]
                    return found
                reason = found
        return reason

    def _start_filter(self, name: str, tick: Tick) -> bool:
        """Create a filter whose frame is the robot's first pose, heading along x, level by the first "up"."""
        ups = [v.odometry.gravity for v in tick.views if v.odometry is not None and v.odometry.gravity is not None]
        if not ups:
            return False
        mounts = {camera: mount for camera, mount in self.setup.mounts.items() if mount.robot == name}
        setup = replace(self.setup, mounts=mounts, starts={name: level_start(ups[0])})
        self._filters[name] = self._build(setup, replace(self.parameters, max_new_landmarks=0))
        return True


def level_start(up: Array) -> Start:
    """A start at the origin with heading along x, for which the direction up (3,) in the body is vertical; roll and pitch are uncertain."""
    z = up / np.linalg.norm(up)
    x = np.array([1.0, 0.0, 0.0]) - z[0] * z
    x /= np.linalg.norm(x)
    rotation = np.stack([x, np.cross(z, x), z])
    covariance = np.zeros((6, 6))
    covariance[:3, :3] = np.eye(3) * FRAME_SIGMA**2
    covariance[3:, 3:] = rotation.T @ np.diag(np.square([LEVEL_SIGMA, LEVEL_SIGMA, FRAME_SIGMA])) @ rotation
    return Start(Pose(rotation, np.zeros(3)), covariance)
