"""Detections of people, sightings of landmarks, and detections of other robots, as directions in the frame of a camera."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from tracker.geometry import Array, Ints, Mask, check_covariances, check_unit, set_array, set_ints


@dataclass(frozen=True, eq=False)
class Detections:
    """People seen by one camera in one frame, as directions. They hold no true ids.

    A box is a span of azimuth and a span of elevation in the camera's frame. The seam of a panorama does not divide it.
    bearing (n, 3) unit, camera frame: to the middle of the box. extent (n, 2) rad: the spans of azimuth and elevation.
    confidence (n,): any finite number, higher is surer.
    covariance (n, 2, 2) rad² of an edge of the box in the tangent plane (geometry.tangent_basis).
    appearance (n, d): vectors of an appearance model, compared by their cosine; d is 0 where there are none, and zeros are unknown.
    feet_seen (n,): False where the detector reports hidden feet; None, which becomes True for all, where it does not report them.
    """

    bearing: Array
    extent: Array
    confidence: Array
    covariance: Array
    appearance: Array
    feet_seen: Mask | None = None

    def __post_init__(self) -> None:
        n = len(self.bearing)
        set_array(self, "bearing", (n, 3))
        set_array(self, "extent", (n, 2))
        set_array(self, "confidence", (n,))
        set_array(self, "covariance", (n, 2, 2))
        set_array(self, "appearance", (n, None))
        seen = np.ones(n, dtype=np.bool_) if self.feet_seen is None else np.array(self.feet_seen, dtype=np.bool_)
        if seen.shape != (n,):
            raise ValueError(f"feet_seen has shape {seen.shape}, needs ({n},)")
        object.__setattr__(self, "feet_seen", seen)
        check_unit(self.bearing, "detection bearing")

    @staticmethod
    def none() -> Detections:
        """No detections."""
        return Detections(np.zeros((0, 3)), np.zeros((0, 2)), np.zeros(0), np.zeros((0, 2, 2)), np.zeros((0, 0)))

    def __len__(self) -> int:
        return len(self.bearing)

    def select(self, rows: Mask) -> Detections:
        """The detections of a mask (n,)."""
        return Detections(*(getattr(self, field.name)[rows] for field in fields(self)))


@dataclass(frozen=True, eq=False)
class Sightings:
    """Landmarks seen by one camera in one frame.

    bearing (n, 3) unit, camera frame. range (n,) m or NaN. subject (n,): id of the landmark, −1 where data association must find it.
    descriptor (n, d). covariance (n, 2, 2) rad² in the tangent plane.
    """

    bearing: Array
    range: Array
    subject: Ints
    descriptor: NDArray[np.float32]
    covariance: Array

    def __post_init__(self) -> None:
        n = len(self.bearing)
        set_array(self, "bearing", (n, 3))
        set_array(self, "covariance", (n, 2, 2))
        set_ints(self, "subject", (n,))
        for name, dtype in (("range", np.float64), ("descriptor", np.float32)):
            array = np.array(getattr(self, name), dtype=dtype)
            if len(array) != n:
                raise ValueError(f"{name} has {len(array)} rows, needs {n}")
            array.flags.writeable = False
            object.__setattr__(self, name, array)
        check_unit(self.bearing, "sighting bearing")
        check_covariances(self.covariance, "covariance of sighting")
        if not (np.isnan(self.range) | (self.range > 0)).all():
            raise ValueError(f"sighting range is {np.nanmin(self.range):.6g} m, needs more than 0, or NaN where it is not measured")

    def __len__(self) -> int:
        return len(self.bearing)


@dataclass(frozen=True, eq=False)
class RobotDetections:
    """Other robots seen by one camera in one frame, each with its name.

    bearing (n, 3) unit, camera frame: to the centre of the seen robot's camera (Setup.mount_of). robot: n distinct names.
    covariance (n, 2, 2) rad² in the tangent plane.
    """

    bearing: Array
    robot: tuple[str, ...]
    covariance: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "robot", tuple(map(str, self.robot)))
        n = len(self.robot)
        set_array(self, "bearing", (n, 3))
        set_array(self, "covariance", (n, 2, 2))
        check_unit(self.bearing, "robot bearing")
        check_covariances(self.covariance, "covariance of robot detection")
        if len(set(self.robot)) < n:
            raise ValueError(f"detected robots are {', '.join(self.robot)}, needs each robot once")

    @staticmethod
    def none() -> RobotDetections:
        """No detections."""
        return RobotDetections(np.zeros((0, 3)), (), np.zeros((0, 2, 2)))

    def __len__(self) -> int:
        return len(self.robot)

    def choose(self, robots: Collection[str]) -> RobotDetections:
        """The detections of these robots alone."""
        kept = [k for k, robot in enumerate(self.robot) if robot in robots]
        return self if len(kept) == len(self) else RobotDetections(self.bearing[kept], tuple(self.robot[k] for k in kept), self.covariance[kept])
