"""What goes into the tracker and what comes out: values, made once, checked at once, never changed.

Arrays are copied and read-only. Frames follow the README: a camera's frame is x forward, y left, z up.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from tracker.cameras import Camera, Mask
from tracker.geometry import Array, Pose, frozen
from tracker.ground import Ground

Ints = NDArray[np.int64]
Image = NDArray[np.uint8]


def _set(instance: object, name: str, shape: tuple[int | None, ...]) -> None:
    object.__setattr__(instance, name, frozen(getattr(instance, name), shape, name))


def _set_ints(instance: object, name: str, n: int) -> None:
    array = np.array(getattr(instance, name), dtype=np.int64)
    if array.shape != (n,):
        raise ValueError(f"{name} has shape {array.shape}, needs ({n},)")
    array.flags.writeable = False
    object.__setattr__(instance, name, array)


def _check_unit(bearing: Array, name: str) -> None:
    error = np.abs(np.linalg.norm(bearing, axis=1) - 1)
    if error.size and error.max() > 1e-6:
        raise ValueError(f"{name} has length {1 + error.max():.6g} off 1, needs unit directions")


def _check_covariance(covariance: Array, name: str) -> None:
    """(n, n): symmetric and not negative, up to rounding; a direction that is known exactly is none of its faults."""
    scale = float(np.abs(covariance).max(initial=0.0))
    if not np.isfinite(scale) or np.abs(covariance - covariance.T).max(initial=0.0) > 1e-9 * scale:
        raise ValueError(f"{name} is not finite and symmetric")
    low = float(np.linalg.eigvalsh(covariance)[0])
    if low < -1e-9 * scale:
        raise ValueError(f"{name} has an eigenvalue of {low:.3g}, needs at least 0")


def _check_covariances(covariance: Array, name: str) -> None:
    """(n, 2, 2): symmetric and positive, each."""
    a, b, c = covariance[:, 0, 0], covariance[:, 0, 1], covariance[:, 1, 1]
    sound = np.isfinite(covariance).all(axis=(1, 2)) & (a > 0) & (a * c > b * b) & (np.abs(b - covariance[:, 1, 0]) <= 1e-9 * (a + c))
    if not sound.all():
        worst = int(np.argmin(sound))
        raise ValueError(f"{name} {worst} is {covariance[worst].tolist()}, needs a symmetric positive matrix")


@dataclass(frozen=True, eq=False)
class Detections:
    """People seen by one camera in one frame, as directions: nothing can straddle a seam. Never a true id.

    A box is a span of azimuth and one of elevation in the camera's frame (columns of a pinhole image are meridians, too).
    bearing (n, 3) unit, camera frame: to the middle of the box. extent (n, 2) rad: the spans of azimuth and elevation.
    confidence (n,) in [0, 1]. covariance (n, 2, 2) rad² of an edge of the box in the tangent plane (geometry.tangent_basis).
    appearance (n, d).
    """

    bearing: Array
    extent: Array
    confidence: Array
    covariance: Array
    appearance: Array

    def __post_init__(self) -> None:
        n = len(self.bearing)
        _set(self, "bearing", (n, 3))
        _set(self, "extent", (n, 2))
        _set(self, "confidence", (n,))
        _set(self, "covariance", (n, 2, 2))
        _set(self, "appearance", (n, None))
        _check_unit(self.bearing, "detection bearing")

    @staticmethod
    def none() -> Detections:
        return Detections(np.zeros((0, 3)), np.zeros((0, 2)), np.zeros(0), np.zeros((0, 2, 2)), np.zeros((0, 0)))

    def __len__(self) -> int:
        return len(self.bearing)


@dataclass(frozen=True, eq=False)
class Sightings:
    """Landmarks seen by one camera in one frame.

    bearing (n, 3) unit, camera frame; range (n,) m or NaN; subject (n,): which landmark, −1 where that must be found;
    descriptor (n, d); covariance (n, 2, 2) rad² in the tangent plane.
    """

    bearing: Array
    range: Array
    subject: Ints
    descriptor: NDArray[np.float32]
    covariance: Array

    def __post_init__(self) -> None:
        n = len(self.bearing)
        _set(self, "bearing", (n, 3))
        _set(self, "covariance", (n, 2, 2))
        _set_ints(self, "subject", n)
        for name, dtype in (("range", np.float64), ("descriptor", np.float32)):
            array = np.array(getattr(self, name), dtype=dtype)
            if len(array) != n:
                raise ValueError(f"{name} has {len(array)} rows, needs {n}")
            array.flags.writeable = False
            object.__setattr__(self, name, array)
        _check_unit(self.bearing, "sighting bearing")
        _check_covariances(self.covariance, "covariance of sighting")
        if not (np.isnan(self.range) | (self.range > 0)).all():
            raise ValueError(f"sighting range is {np.nanmin(self.range):.6g} m, needs more than 0, or NaN where it is not measured")

    def __len__(self) -> int:
        return len(self.bearing)


@dataclass(frozen=True, eq=False)
class Companions:
    """Other robots seen by one camera in one frame, each known by its name.

    bearing (n, 3) unit, camera frame: to the middle of the seen robot's camera (Setup.mount_of); robot: names (n,), none twice; covariance
    (n, 2, 2) rad² in the tangent plane.
    """

    bearing: Array
    robot: tuple[str, ...]
    covariance: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "robot", tuple(map(str, self.robot)))
        n = len(self.robot)
        _set(self, "bearing", (n, 3))
        _set(self, "covariance", (n, 2, 2))
        _check_unit(self.bearing, "bearing of a companion")
        _check_covariances(self.covariance, "covariance of companion")
        if len(set(self.robot)) < n:
            raise ValueError(f"companions are {', '.join(self.robot)}, needs each robot once")

    @staticmethod
    def none() -> Companions:
        return Companions(np.zeros((0, 3)), (), np.zeros((0, 2, 2)))

    def __len__(self) -> int:
        return len(self.robot)


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
        _set(self, "covariance", (6, 6))
        _check_covariance(self.covariance, "covariance of odometry")
        if self.gravity is not None:
            _set(self, "gravity", (3,))
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
    companions: Companions | None = None


@dataclass(frozen=True, eq=False)
class Tick:
    """One moment: index from 0, time = index · period in seconds, one View a camera that reported."""

    index: int
    time: float
    views: tuple[View, ...]


@dataclass(frozen=True, eq=False)
class Truth:
    """What was so at one tick. T_world_robot a robot; person_id (m,); feet (m, 3) m: the ground under the middle of the body;
    visible (m, cameras): pixels seen over the pixels that the person would cover alone, in [0, 1], cameras in the order of Setup.mounts.
    joints (m, 17, 3) m: the key points of COCO (layout.KEYPOINT_NAMES), or None where they were not read (annotations.read_joints reads them).
    tipped: the robots that have tipped over: their odometry and panoramas are still there, but nobody should expect much of them.
    """

    index: int
    T_world_robot: dict[str, Pose]
    person_id: Ints
    feet: Array
    visible: Array
    joints: Array | None = None
    tipped: frozenset[str] = frozenset()

    def __post_init__(self) -> None:
        n = len(self.person_id)
        if not self.tipped <= set(self.T_world_robot):
            raise ValueError(f"tipped is {sorted(self.tipped)}, needs robots of {sorted(self.T_world_robot)}")
        _set_ints(self, "person_id", n)
        _set(self, "feet", (n, 3))
        _set(self, "visible", (n, None))
        if self.joints is not None:
            _set(self, "joints", (n, 17, 3))
        if len(np.unique(self.person_id)) != n:
            raise ValueError(f"truth of frame {self.index} has a person twice")


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
        _set(self, "covariance", (6, 6))
        _check_covariance(self.covariance, "covariance of start")


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
        _set(self, "pillars", (None, 5))
        if not self.period > 0:
            raise ValueError(f"period is {self.period} s, needs more than 0")
        if self.area is not None:
            _set(self, "area", (2, 2))
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

    def check_companions(self, camera: str, companions: Companions) -> None:
        """Raises ValueError for robots without a camera, and for a robot that sees itself."""
        for robot in companions.robot:
            self.mount_of(robot)
            if robot == self.mounts[camera].robot:
                raise ValueError(f"{camera} sees robot {robot!r}, which carries it; needs another one")


@dataclass(frozen=True, eq=False)
class Chart:
    """The map at one tick: identity (m,), never used again, place (m, 3) m; sighted: robot → the identities (k,) that it saw at this tick."""

    identity: Ints
    place: Array
    sighted: dict[str, Ints]


@dataclass(frozen=True, eq=False)
class Survey:
    """The charts of a run as one: places, landmark → (3,) m where it was last believed to be; final: those in the map at the end; sighted: a frame,
    robot → landmarks (k,) that it saw.
    """

    places: dict[int, Array]
    final: Ints
    sighted: tuple[dict[str, Ints], ...]

    @staticmethod
    def of(charts: list[Chart]) -> Survey:
        """Of a chart a frame."""
        places = {int(n): place for chart in charts for n, place in zip(chart.identity, chart.place, strict=True)}
        return Survey(places, charts[-1].identity if charts else np.zeros(0, dtype=np.int64), tuple(chart.sighted for chart in charts))

    @property
    def map(self) -> Array:
        """(m, 3) m: the map at the end."""
        return np.array([self.places[int(n)] for n in self.final]).reshape(-1, 3)


@dataclass(frozen=True, eq=False)
class Estimate:
    """What the tracker believes at one tick.

    T_world_robot and covariance (6, 6) of its right tangent a robot; target_id (k,), never used again; position (k, 3) m on the ground;
    covariance (k, 3, 3) m²; chart: the map, or None where the tracker tells of none.
    """

    index: int
    T_world_robot: dict[str, Pose]
    robot_covariance: dict[str, Array]
    target_id: Ints
    position: Array
    covariance: Array
    counters: dict[str, int] = field(default_factory=dict)
    chart: Chart | None = None

    @staticmethod
    def of_robots(index: int, T_world_robot: dict[str, Pose], covariance: dict[str, Array], counters: dict[str, int]) -> Estimate:
        """Nobody is there yet."""
        return Estimate(index, T_world_robot, covariance, np.zeros(0, dtype=np.int64), np.zeros((0, 3)), np.zeros((0, 3, 3)), counters)

    def __post_init__(self) -> None:
        n = len(self.target_id)
        _set_ints(self, "target_id", n)
        _set(self, "position", (n, 3))
        _set(self, "covariance", (n, 3, 3))
