"""A synthetic crowd among fixed panoramas, computed from geometry alone: a setup, paths, and ticks with detections.

It serves studies and tests of the tracker without a simulator. People do not avoid or occlude each other.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from tracker.geometry import Array, Pose, bearing_from_angles
from tracker.geometry.cameras import Panorama
from tracker.geometry.ground import Flat, Grid, Ground
from tracker.types import Detections, Mount, Setup, Start, Tick, View

CAMERA_HEIGHT = 1.5
"""m: height of the cameras above the ground."""
HEIGHT, WIDTH = 1.75, 0.5
"""m: of a person."""
RATE = 6.0
"""Ticks per second."""
CAMERA_POSES = (
    (-6.0, -5.0, 0.3), (6.0, -5.0, 2.0), (0.0, 6.0, -1.6), (-6.5, 5.0, -0.5), (6.5, 5.0, -2.4), (0.0, -6.5, 1.6), (-7.5, 0.0, 0.0),
)  # fmt: skip
"""x, y m and yaw rad of each camera."""


def setup(views: int = 3, ground: Ground | None = None, area: Array | None = None) -> Setup:
    """A setup of level panoramas at the first `views` CAMERA_POSES, on robots that stand still. Raises ValueError for an invalid number."""
    if not 1 <= views <= len(CAMERA_POSES):
        raise ValueError(f"views is {views}, needs 1 to {len(CAMERA_POSES)}")
    ground = ground or Flat()
    mounts = {f"camera_{k}": Mount(Panorama(1024, 512), Pose.identity(), f"robot_{k}") for k in range(views)}
    starts: dict[str, Start | None] = {}
    for k, (x, y, yaw) in enumerate(CAMERA_POSES[:views]):
        z = float(ground.height_at(np.array([[x, y]]))[0]) + CAMERA_HEIGHT
        starts[f"robot_{k}"] = Start(Pose.planar(x, y, yaw, z), np.zeros((6, 6)))
    return Setup(mounts, ground, starts, 1 / RATE, area=area)


def hills() -> Grid:
    """A smooth terrain with heights between −0.3 m and 0.3 m."""
    x, y = np.meshgrid(np.linspace(-10, 10, 81), np.linspace(-10, 10, 81))
    return Grid(0.3 * np.sin(0.7 * x) * np.cos(0.5 * y), np.array([-10.0, -10.0]), 0.25)


def paths(people: int, frames: int, rng: np.random.Generator) -> Array:
    """Paths (frames, people, 2) m: straight at 0.5 to 1.4 m/s in a square of 8 m, reflected at its border."""
    position, heading = rng.uniform(-4, 4, (people, 2)), rng.uniform(-np.pi, np.pi, people)
    step = np.stack([np.cos(heading), np.sin(heading)], axis=1) * rng.uniform(0.5, 1.4, people)[:, None] / RATE
    out = []
    for _ in range(frames):
        step = np.where(np.abs(position + step) > 4, -step, step)
        position = position + step
        out.append(position)
    return np.array(out)


def boxes(pose: Pose, feet: Array) -> tuple[Array, Array]:
    """Boxes of upright people at feet (n, 3) m in a level camera: bearings of the centres (n, 3) and extents (n, 2) rad.

    pose: T_world_camera.
    """
    local = pose.inverse().apply(feet)
    distance, azimuth = np.hypot(local[:, 0], local[:, 1]), np.arctan2(local[:, 1], local[:, 0])
    low, high = np.arctan2(local[:, 2], distance), np.arctan2(local[:, 2] + HEIGHT, distance)
    return bearing_from_angles(azimuth, (low + high) / 2), np.stack([WIDTH / distance, high - low], axis=1)


def ticks(
    crowd: Setup,
    walked: Array,
    rng: np.random.Generator,
    *,
    noise: float = 0.002,
    misses: float = 0.1,
    clutter: float = 0.05,
    lose: Callable[[int, str, int], bool] = lambda frame, camera, person: False,
) -> list[Tick]:
    """Ticks with detections of people at `walked` (frames, people, 2) m.

    noise: standard deviation of the bearings, rad. misses: probability of a missed detection. clutter: mean false boxes per view and tick.
    lose: frame, camera, person → whether the detection is missed in any case.
    """
    out = []
    for k, positions in enumerate(walked):
        feet = np.column_stack([positions, crowd.ground.height_at(positions)])
        views = []
        for name, mount in crowd.mounts.items():
            start = crowd.starts[mount.robot]
            assert start is not None
            middle, extent = boxes(start.T_world_robot, feet)
            keep = (rng.random(len(feet)) >= misses) & ~np.array([lose(k, name, p) for p in range(len(feet))], dtype=bool)
            false_boxes = rng.poisson(clutter)
            azimuth, distance = rng.uniform(-np.pi, np.pi, false_boxes), rng.uniform(2, 9, false_boxes)
            low, high = np.arctan2(-CAMERA_HEIGHT, distance), np.arctan2(0.25, distance)
            middle = np.concatenate([middle[keep], bearing_from_angles(azimuth, (low + high) / 2)])
            extent = np.concatenate([extent[keep], np.stack([0.5 / distance, high - low], axis=1)])
            middle = middle + rng.normal(0, noise, middle.shape)
            middle /= np.linalg.norm(middle, axis=1, keepdims=True)
            order = rng.permutation(len(middle))
            covariance = np.tile(max(noise, 1e-4) ** 2 * np.eye(2), (len(middle), 1, 1))
            found = Detections(middle[order], extent[order], np.full(len(middle), 0.9), covariance, np.zeros((len(middle), 0)))
            views.append(View(name, found))
        out.append(Tick(k, k / RATE, tuple(views)))
    return out
