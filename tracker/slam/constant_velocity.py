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
    """The last poses of one robot. period: s of a tick."""

    period: float
    poses: list[Pose] = field(default_factory=list)

    def step(self, pose: Pose) -> tuple[Pose, Array] | None:
        """The motion since the last tick and its covariance (6, 6), by the estimate of the pose there; None at the first tick."""
        self.poses = [*self.poses[-2:], pose]
        if len(self.poses) == 1:
            return None
        moved = self.poses[-2].inverse() @ pose
        if len(self.poses) == 2 or np.linalg.norm(moved.translation) > FASTEST * self.period:
            return Pose.planar(AHEAD * self.period, 0.0, 0.0), (SPREAD * self.period) ** 2 * np.eye(6)
        return moved, (ACCELERATION * self.period**2) ** 2 * np.eye(6)
