"""The motion of a robot without odometry: it goes on as it moved between the last two ticks (constant velocity with white acceleration noise).

Bearings alone do not tell how long a way is. The scale of the map is that of the velocity that is assumed at the start.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from tracker.geometry import Array, Pose

ACCELERATION = 1.0
"""m/s² and rad/s²: standard deviation of the accelerations between two ticks."""
AHEAD, SPREAD = 0.3, 0.3
"""m/s: velocity ahead at the start, and its standard deviation, m/s and rad/s. A robot that stood would not show how far anything is."""
FASTEST = 3.0
"""m/s: a robot that seems to be faster was relocalized, and starts anew."""


@dataclass(eq=False)
class ConstantVelocity:
    """The last poses of one robot."""

    poses: list[Pose] = field(default_factory=list)

    seconds: float = 0.0

    def step(self, pose: Pose, seconds: float) -> tuple[Pose, Array] | None:
        """The motion in the last `seconds` and its covariance (6, 6), by the estimate of the pose before them; None at the first tick."""
        self.poses, before, self.seconds = [*self.poses[-2:], pose], self.seconds, seconds
        if len(self.poses) == 1:
            return None
        moved = self.poses[-2].inverse() @ pose
        if len(self.poses) == 2 or np.linalg.norm(moved.translation) > FASTEST * before:
            return Pose.planar(AHEAD * seconds, 0.0, 0.0), (SPREAD * seconds) ** 2 * np.eye(6)
        if seconds != before:
            moved = Pose.exp(moved.log() * (seconds / before))
        return moved, (ACCELERATION * seconds**2) ** 2 * np.eye(6)
