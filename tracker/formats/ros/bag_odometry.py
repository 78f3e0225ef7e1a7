"""The path of a robot from its odometry topic, and the direction of up from its IMU, at arbitrary times."""

from __future__ import annotations

from array import array
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np

from tracker.formats.ros.bag_values import stamp_of
from tracker.formats.ros.frame_tree import bare, pose_from_message
from tracker.formats.ros.messages import GRAVITY
from tracker.geometry import Array, Ints, Mask, Pose
from tracker.types import Odometry

LARGEST = 1e3
"""(m/s)² and (rad/s)²: a larger variance of a velocity is a placeholder. Many robots send one for axes that they do not measure."""
DRIFT = np.repeat([0.05, 0.035], 3)
"""m and rad after one metre (and 0.035 rad after one rad): random walk of an odometry that does not state its error."""
STANDING = 1e-3
"""m and rad after one second: the same for a standing robot."""
UP_SIGMA = 0.02
"""rad: least error of the direction of up from an IMU on a moving robot, the default of Odometry."""


@dataclass(eq=False)
class OdometryPath:
    """Messages of an odometry topic in the order of their stamps. frame, child: its frames. stamps [ns].

    values: 42 numbers a message: pose log (6,) in the parent frame, and covariance (6, 6) of the velocity.
    """

    topic: str
    frame: str = ""
    child: str = ""
    stamps: array[int] = field(default_factory=lambda: array("q"))
    values: array[float] = field(default_factory=lambda: array("d"))

    def add(self, message: Any) -> None:
        """Add an Odometry. Raises ValueError for an invalid pose."""
        if not self.stamps:
            self.frame, self.child = bare(message.header.frame_id), bare(message.child_frame_id) or "base_link"
        pose = pose_from_message(message.pose.pose.position, message.pose.pose.orientation)
        self.stamps.append(stamp_of(message))
        self.values.extend(pose.log().tolist())
        self.values.extend(message.twist.covariance.tolist())

    @cached_property
    def _times(self) -> Ints:
        return np.frombuffer(self.stamps, dtype=np.int64)

    @cached_property
    def _rows(self) -> Array:
        return np.frombuffer(self.values, dtype=np.float64).reshape(-1, 42)

    @property
    def first(self) -> Pose:
        """T_frame_child of the first message."""
        return Pose.exp(self._rows[0, :6])

    def pose(self, stamp: int) -> Pose | None:
        """T_frame_child at a time [ns], between two messages at constant velocity; None more than an interval outside the messages."""
        times = self._times
        if len(times) < 2:
            return self.first if len(times) and stamp == times[0] else None
        reach = np.median(np.diff(times))
        if not times[0] - reach <= stamp <= times[-1] + reach:
            return None
        k = int(np.clip(np.searchsorted(times, stamp, side="left"), 1, len(times) - 1))
        before, after = Pose.exp(self._rows[k - 1, :6]), Pose.exp(self._rows[k, :6])
        share = (stamp - times[k - 1]) / (times[k] - times[k - 1])
        if share == 1.0:
            return after
        return before @ Pose.exp(share * (before.inverse() @ after).log())

    @cached_property
    def unstated(self) -> list[str]:
        """The axes whose variance the messages do not state."""
        return [name for name, stated in zip(("x", "y", "z", "roll", "pitch", "yaw"), self._stated, strict=True) if not stated]

    @cached_property
    def _stated(self) -> Mask:
        """(6,) whether the messages state a variance of the axis, which may be 0 where the robot stands."""
        variances = self._rows[:, 6:].reshape(-1, 6, 6).diagonal(axis1=1, axis2=2)
        return np.asarray((variances > 0).any(axis=0) & (variances < LARGEST).all(axis=0))

    @cached_property
    def _summed(self) -> Array:
        """(n, 6, 6): covariance of the motion since the first message. Errors of the messages are independent of each other."""
        seconds = np.diff(self._times) / 1e9
        rows = self._rows[1:, 6:].reshape(-1, 6, 6)
        # Some robots send NaN or infinity for what they do not know.
        stated = np.outer(self._stated, self._stated) & np.isfinite(rows)
        steps = np.where(stated, rows, 0.0) * seconds[:, None, None] ** 2
        if self.unstated:
            poses = [Pose.exp(row) for row in self._rows[:, :6]]
            moved = np.array([(a.inverse() @ b).log() for a, b in pairwise(poses)]).reshape(-1, 6)
            way = np.linalg.norm(moved[:, :3], axis=1) + np.linalg.norm(moved[:, 3:], axis=1)
            default = way[:, None] * DRIFT**2 + seconds[:, None] * STANDING**2
            steps = steps + np.where(self._stated, 0.0, default)[:, :, None] * np.eye(6)
        return np.concatenate([np.zeros((1, 6, 6)), np.cumsum(steps, axis=0, out=steps)])

    def covariance(self, first: int, last: int) -> Array:
        """(6, 6) of the motion between two times [ns]."""
        times, summed = self._times, self._summed
        k = np.clip(np.searchsorted(times, [first, last], side="left"), 1, len(times) - 1)
        share = (np.array([first, last]) - times[k - 1]) / (times[k] - times[k - 1])
        low, high = summed[k - 1] + share[:, None, None] * (summed[k] - summed[k - 1])
        return np.asarray((high - low + (high - low).T) / 2)


@dataclass(eq=False)
class UpPath:
    """Samples of an IMU. stamps [ns].

    values: 4 numbers a sample: specific force (3,) [m/s²] along the sensor's axes, and its variance [(m/s²)²] or 0.
    """

    topic: str
    frame: str = ""
    stamps: array[int] = field(default_factory=lambda: array("q"))
    values: array[float] = field(default_factory=lambda: array("d"))

    def add(self, message: Any) -> None:
        """Add an Imu."""
        self.frame = self.frame or bare(message.header.frame_id)
        force = message.linear_acceleration
        self.stamps.append(stamp_of(message))
        self.values.extend([force.x, force.y, force.z, max(float(message.linear_acceleration_covariance[0]), 0.0)])

    def up(self, first: int, last: int) -> tuple[Array, float] | None:
        """Direction of up (3,) along the sensor's axes and its error [rad], of the samples after `first` up to `last` [ns]; None without any.

        Accelerations of the robot act as errors; the spread of the samples contains them.
        """
        low, high = np.searchsorted(np.frombuffer(self.stamps, dtype=np.int64), [first, last], side="right")
        rows = np.frombuffer(self.values, dtype=np.float64).reshape(-1, 4)[low:high]
        mean = rows[:, :3].mean(axis=0) if len(rows) else np.zeros(3)
        if not np.linalg.norm(mean) > 0:
            return None
        stated = float(np.sqrt(rows[:, 3].mean())) / GRAVITY
        if len(rows) == 1 and stated:
            return mean / np.linalg.norm(mean), stated
        spread = float(np.sqrt(rows[:, :3].var(axis=0).mean())) / GRAVITY
        return mean / np.linalg.norm(mean), max(UP_SIGMA, spread, stated)


def step_between(path: OdometryPath, first: int, last: int) -> Odometry | None:
    """The motion between two times [ns], or None where the path does not reach that far."""
    before, now = path.pose(first), path.pose(last)
    if before is None or now is None:
        return None
    return Odometry(before.inverse() @ now, path.covariance(first, last))
