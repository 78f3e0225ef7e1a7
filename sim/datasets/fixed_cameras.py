"""Greedy placement of fixed cameras that overlook the walkable area of a world from its border.

Candidates are the outermost free points in evenly spaced directions. In each step the camera with the largest gain is added. A point gains 1 for
its first view and 1/n² for its n-th view. Nothing is random, so the cameras depend on the world alone.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tracker.geometry import Array, Pose, rotation_z
from tracker.geometry.cameras import Tsai, pinhole
from tracker.recordings import RecordingCamera
from worlds.engine import mujoco
from worlds.world import World

FIELD_OF_VIEW = math.radians(75.0)
"""Horizontal field of view, rad."""
HEIGHTS = (4.5, 3.0, 2.4)
"""Heights above the ground, m. The highest with free space above it is used."""
DIRECTIONS = 36
"""Number of candidate directions."""
FARTHEST_ABOVE_AXIS = math.radians(16.0)
"""Angle of the farthest people above the optical axis, rad. It keeps the share of sky small."""
CHEST_HEIGHT = 1.2
"""Height above the ground of the point of a person that has to be visible, m."""
NEAREST, FARTHEST = 1.5, 35.0
"""Range of distances of people, m. Nearer people fill the image, and farther ones are only a few pixels high."""
CORNER_HEIGHTS = (2.2, 2.6, 2.4, 2.8)
"""Heights of cameras in corners above the ground, m; those of CMC are 2.1 to 2.2."""
CORNER_VIEW, CORNER_TARGET = math.radians(82.0), 0.8
"""Horizontal field of view of cameras in corners, as in CMC, rad; height above the ground at which they aim, m."""
SAMPLES = 300
"""Number of sample points of the walkable area."""
MIN_SEPARATION = 0.4
"""Distance between cameras, over the extent of the candidates, below which their gain is reduced."""
_MARGIN, _HEADROOM = 0.9, 0.3
"""Clearance of a camera to the sides and above, m."""


@dataclass(frozen=True, eq=False)
class _RayScene:
    """A compiled world for ray casting. chests (n, 3) m: points spread evenly over the walkable area."""

    model: mujoco.MjModel
    data: mujoco.MjData
    chests: Array

    @staticmethod
    def of(world: World) -> _RayScene:
        model = world.spec.copy().compile()
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        i, j = np.nonzero(world.feet.free)
        chosen = np.unique(np.linspace(0, len(i) - 1, SAMPLES).round().astype(np.int64))
        # The points are ordered along a curve that fills the grid in strips, so that equal steps cover it evenly.
        strips = np.lexsort((np.where((i // 8) % 2 == 0, j, -j), i // 8))
        points = world.feet.origin + world.feet.spacing * np.stack([j, i], axis=1)[strips][chosen]
        return _RayScene(model, data, np.column_stack([points, world.terrain.height_at(points) + CHEST_HEIGHT]))

    def hit(self, start: Array, direction: Array) -> float:
        """Distance to the first hit of a ray, m; inf without a hit."""
        distance = mujoco.mj_ray(self.model, self.data, start, direction, None, 1, -1, np.zeros(1, np.int32), None)
        return float(distance) if distance >= 0 else math.inf

    def is_free(self, start: Array, end: Array) -> bool:
        """Whether the segment between two points (3,) m is free."""
        offset = end - start
        length = float(np.linalg.norm(offset))
        return self.hit(start, offset / length) > length


def place_cameras(world: World, count: int, width: int) -> dict[str, RecordingCamera]:
    """The cameras by name. Their images are `width` px wide and three quarters as high.

    Raises ValueError where fewer than `count` candidates see people.
    """
    if not count:
        return {}
    scene, camera = _RayScene.of(world), pinhole(width, round(width * 0.75), FIELD_OF_VIEW)
    positions = [position for position in (_camera_position(world, scene, k) for k in range(DIRECTIONS)) if position is not None]
    poses = [pose for position in positions if (pose := _aimed_pose(scene, position)) is not None]
    visible = np.array([_visibility(scene, camera, pose) for pose in poses]).reshape(len(poses), len(scene.chests))
    at = np.array([pose.translation for pose in poses]).reshape(-1, 3)
    separation = MIN_SEPARATION * max(float(np.ptp(at, axis=0).max(initial=0.0)), 1e-9) if len(at) else 1.0
    chosen: list[int] = []
    views = np.zeros(len(scene.chests))
    while len(chosen) < count:
        gain = (visible / (1.0 + views) ** 2).sum(axis=1)
        for k in chosen:
            gain *= np.clip(np.linalg.norm(at - at[k], axis=1) / separation, 0.0, 1.0)
        if not gain.any():
            raise ValueError(f"views is {count}, more than the {len(chosen)} cameras that see people in {world.name}")
        chosen.append(int(np.argmax(gain)))
        views += visible[chosen[-1]]
    return {f"View_{n:03d}": RecordingCamera(camera, poses[k]) for n, k in enumerate(sorted(chosen), 1)}


def corner_cameras(world: World, count: int, width: int) -> dict[str, RecordingCamera]:
    """Up to four cameras by name in the corners of the box around the free space, CORNER_HEIGHTS above the ground, aimed at its middle.

    This is for rooms, whose free space is a box. Images are `width` px wide and three quarters as high.
    Raises ValueError for more than four cameras.
    """
    if count > len(CORNER_HEIGHTS):
        raise ValueError(f"views is {count}, a room has {len(CORNER_HEIGHTS)} corners")
    points = world.feet.points(world.feet.free)
    (x0, y0), (x1, y1) = points.min(axis=0), points.max(axis=0)
    camera, middle = pinhole(width, round(width * 0.75), CORNER_VIEW), np.array([(x0 + x1) / 2, (y0 + y1) / 2])
    target = np.array([*middle, float(world.terrain.height_at(middle[None])[0]) + CORNER_TARGET])
    out = {}
    for k, (place, height) in enumerate(zip(((x0, y0), (x1, y1), (x0, y1), (x1, y0)), CORNER_HEIGHTS, strict=True)):
        eye = np.array([*place, float(world.terrain.height_at(np.array([place]))[0]) + height])
        if k < count:
            out[f"View_{k + 1:03d}"] = RecordingCamera.looking_at(camera, eye, target)
    return out


def _camera_position(world: World, scene: _RayScene, k: int) -> Array | None:
    """The position (3,) m of a camera at the border in the k-th direction, or None where none is free."""
    angle = 2 * np.pi * (k + 0.5) / DIRECTIONS
    points = world.feet.points(world.feet.clearance >= min(_MARGIN - 0.5, float(world.feet.clearance.max())))
    ahead = (points - points.mean(axis=0)) @ rotation_z(angle)[:2, :2]
    at = points[int(np.argmax(ahead[:, 0] - np.abs(ahead[:, 1])))]
    ground = float(world.terrain.height_at(at[None])[0])
    headroom = scene.hit(np.array([*at, ground + 0.1]), np.array([0.0, 0.0, 1.0])) + 0.1 - _HEADROOM
    return next((np.array([*at, ground + height]) for height in HEIGHTS if height <= headroom), None)


def _aimed_pose(scene: _RayScene, position: Array) -> Pose | None:
    """The camera pose at a position that sees the most points, or None where it sees none."""
    offset = scene.chests - position
    distance = np.linalg.norm(offset, axis=1)
    near = np.flatnonzero((distance > NEAREST) & (distance < FARTHEST))
    seen = offset[[k for k in near if scene.is_free(position, scene.chests[k])]]
    if not len(seen):
        return None
    azimuth = np.arctan2(seen[:, 1], seen[:, 0])
    yaws = 2 * np.pi * np.arange(72) / 72
    inside = np.abs(np.mod(azimuth - yaws[:, None] + np.pi, 2 * np.pi) - np.pi) < FIELD_OF_VIEW / 2
    best = int(np.argmax(inside.sum(axis=1)))
    yaw, ahead = float(yaws[best]), seen[inside[best]]
    below = np.arctan2(-ahead[:, 2], np.hypot(ahead[:, 0], ahead[:, 1]))
    down = float(np.quantile(below, 0.05)) + FARTHEST_ABOVE_AXIS
    pitch = Pose.exp(np.array([0.0, 0.0, 0.0, 0.0, down, 0.0]))
    return Pose(rotation_z(yaw), position) @ pitch


def _visibility(scene: _RayScene, camera: Tsai, pose: Pose) -> Array:
    """1.0 where a chest is in the image and not occluded, else 0.0 (n,)."""
    offset = scene.chests - pose.translation
    distance = np.linalg.norm(offset, axis=1)
    _, inside = camera.pixels_from_bearings(pose.inverse().apply(scene.chests))
    out = np.zeros(len(offset))
    for k in np.flatnonzero(inside & (distance > NEAREST) & (distance < FARTHEST)):
        out[k] = scene.is_free(pose.translation, scene.chests[k])
    return out
