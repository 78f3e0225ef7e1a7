"""What the tracker is told once: cameras and their mounts, the ground, the starts of the robots, and the area of interest."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from tracker.geometry import Array, Mask, Pose, check_covariance, set_array
from tracker.geometry.cameras import Camera
from tracker.geometry.ground import Ground
from tracker.types.detections import RobotDetections


@dataclass(frozen=True, eq=False)
class Mount:
    """A camera on a robot."""

    camera: Camera
    T_body_camera: Pose
    robot: str


@dataclass(frozen=True, eq=False)
class Start:
    """Where a robot stands before the first tick: pose and covariance (6, 6) of its right tangent."""

    T_world_robot: Pose
    covariance: Array

    def __post_init__(self) -> None:
        set_array(self, "covariance", (6, 6))
        check_covariance(self.covariance, "covariance of start")


@dataclass(frozen=True, eq=False)
class Setup:
    """What the tracker is told once: mounts (camera name → Mount), the ground as far as it is known, start poses, period s.

    starts: robot → Start, None where unknown. area: (2, 2) m, the lowest and highest x, y in which targets are reported, or None.
    height: the band of people's heights in metres that a detection must fit. occluders: the top of what stands on the ground
    (walls, furniture) as a ground of its own, where it is known: it says what a view cannot see. pillars (p, 5): upright round things that hide
    people where no occluders are known, each x, y, radius, lowest and highest z in metres.
    """

    mounts: dict[str, Mount]
    ground: Ground
    starts: dict[str, Start | None]
    period: float
    area: Array | None = None
    height: tuple[float, float] = (1.4, 2.3)
    occluders: Ground | None = None
    pillars: Array = field(default_factory=lambda: np.zeros((0, 5)))

    def __post_init__(self) -> None:
        set_array(self, "pillars", (None, 5))
        if not self.period > 0:
            raise ValueError(f"period is {self.period} s, needs more than 0")
        if self.area is not None:
            set_array(self, "area", (2, 2))
        missing = {m.robot for m in self.mounts.values()} - set(self.starts)
        if missing:
            raise ValueError(f"robots {sorted(missing)} carry cameras and have no entry in starts")

    def is_fixed(self, robot: str) -> bool:
        """Whether a robot is a fixed camera: its start pose is known and has zero covariance."""
        start = self.starts[robot]
        return start is not None and not start.covariance.any()

    @property
    def moving_robots(self) -> tuple[str, ...]:
        """Robots that are no fixed cameras, in the order of `starts`, whether their start pose is known or not."""
        return tuple(robot for robot in self.starts if not self.is_fixed(robot))

    @property
    def anchored_robots(self) -> tuple[str, ...]:
        """Those of `moving_robots` whose start pose is known: they define the world frame."""
        return tuple(robot for robot in self.moving_robots if self.starts[robot] is not None)

    def contains(self, points: Array) -> Mask:
        """Points (n, 2) or (n, 3) m, world → (n,): whether they lie in the area or on its edge. Without an area all do."""
        if self.area is None:
            return np.ones(len(points), dtype=np.bool_)
        low, high = self.area
        return np.asarray(((points[:, :2] >= low) & (points[:, :2] <= high)).all(axis=1))

    def distance_beyond(self, points: Array) -> Array:
        """Points (n, 2) or (n, 3) m, world → (n,) m outside the area along x or y, whichever is more; 0 inside. Without an area all are 0."""
        if self.area is None:
            return np.zeros(len(points))
        low, high = self.area
        return np.asarray(np.maximum(low - points[:, :2], points[:, :2] - high).max(axis=1).clip(min=0.0))

    def mount_of(self, robot: str) -> Mount:
        """The camera that others see of a robot: its first. Raises ValueError for a robot without one."""
        mount = next((m for m in self.mounts.values() if m.robot == robot), None)
        if mount is None:
            raise ValueError(f"robot {robot!r} carries no camera, needs one of {sorted({m.robot for m in self.mounts.values()})}")
        return mount

    def check_companions(self, camera: str, companions: RobotDetections) -> None:
        """Raises ValueError for robots without a camera, and for a robot that sees itself."""
        for robot in companions.robot:
            self.mount_of(robot)
            if robot == self.mounts[camera].robot:
                raise ValueError(f"{camera} sees robot {robot!r}, which carries it; needs another one")
