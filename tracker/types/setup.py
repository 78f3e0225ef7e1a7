"""The constant inputs of the tracker: cameras and their mounts, the ground, start poses of the robots, and the area of interest."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from tracker.geometry import Array, Mask, Pose, check_covariance, set_array
from tracker.geometry.cameras import Camera, Panorama
from tracker.geometry.ground import Ground, inside_area
from tracker.types.detections import RobotDetections


@dataclass(frozen=True, eq=False)
class Mount:
    """A camera on a robot: T_body_camera, and the name of the robot.

    readout: s from the first row to the last of a rolling shutter. exposure: s. The time of a frame is the end of its last row's exposure.
    period: usual s between its frames, 0 for that of the setup.
    own_body (rows, columns): where the camera sees the robot that carries it, over all directions as in a panorama; None where it does not.
    """

    camera: Camera
    T_body_camera: Pose
    robot: str
    readout: float = 0.0
    exposure: float = 0.0
    period: float = 0.0
    own_body: Mask | None = None

    def sees_itself(self, bearings: Array) -> Mask:
        """Whether the robot that carries the camera lies in directions (n, 3), unit, camera frame."""
        if self.own_body is None:
            return np.zeros(len(bearings), dtype=bool)
        rows, columns = self.own_body.shape
        pixels, _ = Panorama(columns, rows).pixels_from_bearings(bearings)
        column, row = np.minimum(pixels.astype(np.int64), [columns - 1, rows - 1]).T
        return np.asarray(self.own_body[row, column])


@dataclass(frozen=True, eq=False)
class Start:
    """The start pose of a robot before the first tick, and the covariance (6, 6) of its right tangent."""

    T_world_robot: Pose
    covariance: Array

    def __post_init__(self) -> None:
        set_array(self, "covariance", (6, 6))
        check_covariance(self.covariance, "covariance of start")


@dataclass(frozen=True, eq=False)
class Setup:
    """The constant inputs of the tracker.

    mounts: camera name → Mount. ground: the terrain. starts: robot → Start, None where unknown. period: s between frames, which are reported.
    area: (2, 2) m, the lowest and highest x, y in which targets are reported, or None for no limit.
    height: lowest and highest stature of a person, m. occluders: height map of walls and furniture, or None where unknown.
    pillars (p, 5): upright cylinders that occlude people where no occluders are known: x, y, radius, lowest and highest z in metres.
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

    @property
    def revisit(self) -> float:
        """s between views of the fastest camera, its usual period. Counts of missed detections are in this unit."""
        return min((mount.period or self.period for mount in self.mounts.values()), default=self.period)

    def is_fixed(self, robot: str) -> bool:
        """Whether `robot` stands for a fixed camera: its start pose is known and has zero covariance."""
        start = self.starts[robot]
        return start is not None and not start.covariance.any()

    @property
    def fixed_places(self) -> Array:
        """x, y (n, 2) m of the robots that stand for fixed cameras."""
        places = [start.T_world_robot.translation[:2] for robot, start in self.starts.items() if start is not None and self.is_fixed(robot)]
        return np.array(places).reshape(-1, 2)

    @property
    def moving_robots(self) -> tuple[str, ...]:
        """Robots that are not fixed cameras, in the order of `starts`, whether their start pose is known or not."""
        return tuple(robot for robot in self.starts if not self.is_fixed(robot))

    @property
    def anchored_robots(self) -> tuple[str, ...]:
        """Those of `moving_robots` whose start pose is known: they define the world frame."""
        return tuple(robot for robot in self.moving_robots if self.starts[robot] is not None)

    def contains(self, points: Array) -> Mask:
        """Points (n, 2) or (n, 3) m, world → (n,) whether each lies in the area or on its edge; all True without an area."""
        return inside_area(points, self.area)

    def distance_beyond(self, points: Array) -> Array:
        """Points (n, 2) or (n, 3) m, world → (n,) m: the larger distance outside the area along x or y; 0 inside or without an area."""
        if self.area is None:
            return np.zeros(len(points))
        low, high = self.area
        return np.asarray(np.maximum(low - points[:, :2], points[:, :2] - high).max(axis=1).clip(min=0.0))

    def mount_of(self, robot: str) -> Mount:
        """The first camera of a robot: other robots detect that camera. Raises ValueError for a robot without a camera."""
        mount = next((m for m in self.mounts.values() if m.robot == robot), None)
        if mount is None:
            raise ValueError(f"robot {robot!r} carries no camera, needs one of {sorted({m.robot for m in self.mounts.values()})}")
        return mount

    def check_robot_detections(self, camera: str, detections: RobotDetections) -> None:
        """Raises ValueError for a detected robot without a camera, and for a robot that detects itself."""
        for robot in detections.robot:
            self.mount_of(robot)
            if robot == self.mounts[camera].robot:
                raise ValueError(f"{camera} sees robot {robot!r}, which carries it, needs another robot")
