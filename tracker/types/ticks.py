"""The measurements of one frame: Odometry, View and Tick. Arrays are copied and read-only."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tracker.geometry import Array, Image, Pose, check_covariance, set_array
from tracker.types.detections import Detections, RobotDetections, Sightings


@dataclass(frozen=True, eq=False)
class Odometry:
    """The motion of a robot's body since the previous tick: T_before_now, covariance (6, 6) of its right tangent [m, rad].

    gravity (3,): direction of "up" in the body frame from the accelerometer, or None. gravity_sigma: its standard deviation per axis, rad.
    """

    T_before_now: Pose
    covariance: Array
    gravity: Array | None = None
    gravity_sigma: float = 0.02

    def __post_init__(self) -> None:
        set_array(self, "covariance", (6, 6))
        check_covariance(self.covariance, "covariance of odometry")
        if self.gravity is not None:
            set_array(self, "gravity", (3,))
            if not np.linalg.norm(self.gravity) > 0 or not self.gravity_sigma > 0:
                raise ValueError(f"gravity is {self.gravity.tolist()} with sigma {self.gravity_sigma} rad, needs a direction and more than 0")


@dataclass(frozen=True, eq=False)
class View:
    """The measurements of one camera at one tick.

    odometry: that of the robot that carries the camera, or None. image (H, W, 3) uint8 RGB or None.
    robot_detections: None where no detector of robots runs. features: what was found in the image ahead of the SLAM filter, or None.
    frame: the camera's own number of the image from 0, None where it is the index of the tick.
    later: s by which the view was taken after the time of the tick, negative for before. People are predicted to that time.
    """

    camera: str
    detections: Detections
    sightings: Sightings | None = None
    odometry: Odometry | None = None
    image: Image | None = None
    robot_detections: RobotDetections | None = None
    features: Sightings | None = None
    frame: int | None = None
    later: float = 0.0


@dataclass(frozen=True, eq=False)
class Tick:
    """The views of one time [s], one for each camera that reported then or shortly before or after.

    index: number of its frame, from 0. reported: whether it is the last tick of that frame, after which its estimate is reported.
    Where all cameras are synchronous, each tick is a frame.
    """

    index: int
    time: float
    views: tuple[View, ...]
    reported: bool = True


ROUNDING = 1e-6
"""Share of an interval by which computed times may be off."""


class Intervals:
    """Real intervals between successive times. Those that differ from `usual` s by rounding alone, and the first one, are `usual`."""

    def __init__(self, usual: float) -> None:
        self.usual = usual
        self._last: float | None = None

    def step(self, time: float) -> float:
        """s since the time before."""
        last, self._last = self._last, time
        return self.usual if last is None or abs(time - last - self.usual) < ROUNDING * self.usual else time - last
