"""True key points of people in an image, and their visibility.

Joints lie inside the body. A joint is visible if the surface in front of it is nearer by no more than the thickness of its limb.
A joint behind the trunk is farther behind the visible surface than that.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tracker.geometry import Array, Ints, Mask, Pose
from tracker.geometry.cameras import Camera
from tracker.types import HIDDEN, KEYPOINT_NAMES, VISIBLE, Keypoints

DEPTH_IN_BODY = {"nose": 0.05, "eye": 0.06, "ear": 0.07, "shoulder": 0.12, "elbow": 0.08, "wrist": 0.07, "hip": 0.17, "knee": 0.10, "ankle": 0.10}
"""m: largest depth of a joint behind the surface of the body, clothes included."""
DEPTH_MARGIN = 0.05
"""m: largest distance of the surface in a neighbouring pixel behind a joint."""
_DEPTHS = np.array([DEPTH_IN_BODY[name.split("_")[-1]] for name in KEYPOINT_NAMES])


@dataclass(frozen=True, eq=False)
class InstanceImage:
    """Instances (H, W), 0 for nobody, and range (H, W) m along the ray, of a camera at T_world_camera."""

    camera: Camera
    T_world_camera: Pose
    instances: NDArray[np.uint16]
    range: NDArray[np.float32]


def image_points(camera: Camera, T_world_camera: Pose, points: Array) -> tuple[Array, Mask]:
    """Project points (n, 3) m, world, to pixels (n, 2) from the image's corner, and tell which are in the image. Others may be NaN."""
    pixels, _ = camera.pixels_from_bearings(T_world_camera.inverse().apply(points))
    pixels = pixels + (0.5 - camera.pixel_centre)
    with np.errstate(invalid="ignore"):
        inside = np.asarray((pixels >= 0).all(axis=1) & (pixels < [camera.width, camera.height]).all(axis=1))
    return pixels, inside


def true_keypoints(image: InstanceImage, persons: Ints, joints: Array) -> Keypoints:
    """Key points of people with ids persons (m,) and joints (m, 17, 3) m, world."""
    m, k = joints.shape[:2]
    points = joints.reshape(-1, 3)
    pixels, inside = image_points(image.camera, image.T_world_camera, points)
    pixels[~inside] = 0.0
    distance = np.linalg.norm(points - image.T_world_camera.translation, axis=1)
    depth = np.broadcast_to(_DEPTHS, (m, k)).ravel()
    shown = _unoccluded(image, pixels, np.repeat(persons, k), distance, depth)
    visibility = np.where(inside, np.where(shown, VISIBLE, HIDDEN), 0)
    return Keypoints(persons, pixels.reshape(m, k, 2), visibility.reshape(m, k))


def _unoccluded(image: InstanceImage, pixels: Array, owner: Ints, distance: Array, depth: Array) -> Mask:
    """Mask (n,) of joints without an occluder that lie on their owner's surface, in the pixel itself or a neighbouring one."""
    height, width = image.instances.shape
    column, row = np.floor(pixels).astype(np.int64).T
    beside = np.zeros(len(pixels), dtype=bool)
    for across in (-1, 0, 1):
        for down in (-1, 0, 1):
            u = column + across
            u = u % width if image.camera.wraps else np.clip(u, 0, width - 1)
            v = np.clip(row + down, 0, height - 1)
            surface = image.range[v, u]
            beside |= (image.instances[v, u] == owner) & (surface > distance - depth) & (surface < distance + depth + DEPTH_MARGIN)
    clear = image.range[np.clip(row, 0, height - 1), np.clip(column, 0, width - 1)] > distance - depth
    return np.asarray(clear & beside)
