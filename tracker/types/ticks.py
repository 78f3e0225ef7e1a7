"""Odometry, View and Tick: what the tracker is given of a frame. Arrays are copied and read-only."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tracker.geometry import Array, Image, Pose, check_covariance, set_array
from tracker.types.detections import Detections, RobotDetections, Sightings


@dataclass(frozen=True, eq=False)
class Odometry:
    """The motion of a robot's body since the tick before: T_before_now, covariance (6, 6) of its right tangent [m, rad].

    gravity: the unit direction of "up" in the body's frame as the accelerometer has it, or None; gravity_sigma its error, rad an axis.
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
    """What one camera has at one tick. image (H, W, 3) uint8 RGB or None; odometry of the robot that carries the camera, or None; companions: None
    where nobody looks for other robots.
    """

    camera: str
    detections: Detections
    sightings: Sightings | None = None
    odometry: Odometry | None = None
    image: Image | None = None
    companions: RobotDetections | None = None


@dataclass(frozen=True, eq=False)
class Tick:
    """One moment: index from 0, time = index · period in seconds, one View a camera that reported."""

    index: int
    time: float
    views: tuple[View, ...]
