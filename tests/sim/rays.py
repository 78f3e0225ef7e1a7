"""Images by exact ray casting, and their comparison with rendered images: the oracle of the renderer."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import mujoco
import numpy as np
from numpy.typing import NDArray

from sim.rendering.cubemap import RenderedImage
from tracker.geometry import Pose
from tracker.geometry.cameras import Camera

GROUPS = np.array([1, 1, 1, 1, 0, 0], np.uint8)


@dataclass(frozen=True, eq=False)
class Agreement:
    """Agreement of a rendered image with exact rays.

    everywhere: share of pixels whose instance is the rays'; inside: that of the pixels more than 1.5 px from any silhouette, and how
    many those are of all, `share`; median, percentile: of the relative error of range there.
    """

    everywhere: float
    inside: float
    share: float
    median: float
    percentile: float


def bearings(camera: Camera) -> NDArray[np.float64]:
    """Directions (H W, 3) of all pixel centres."""
    half = camera.pixel_centre
    u, v = np.meshgrid(np.arange(camera.width) + half, np.arange(camera.height) + half)
    return camera.bearings_from_pixels(np.stack([u.ravel(), v.ravel()], axis=1))


def cast(model: mujoco.MjModel, data: mujoco.MjData, camera: Camera, pose: Pose) -> tuple[NDArray[np.int32], NDArray[np.float64]]:
    """Geom (H, W), −1 for none, and range (H, W) m, inf for none, of the ray through every pixel centre."""
    directions = np.ascontiguousarray(bearings(camera) @ pose.rotation.T)
    geom, distance = np.zeros((len(directions), 1), np.int32), np.zeros((len(directions), 1))
    mujoco.mj_multiRay(model, data, pose.translation.copy(), directions.ravel(), GROUPS, 1, -1, geom, distance, None, len(directions), 1e6)
    shape = (camera.height, camera.width)
    return geom.reshape(shape), np.where(geom < 0, np.inf, distance).reshape(shape)


def silhouettes(label: NDArray[np.int32], distance: NDArray[np.floating]) -> NDArray[np.bool_]:
    """Pixels within 1.5 px of a change of the label or a jump of the range, across the seam too."""
    edge, nearness = np.zeros(label.shape, bool), 1 / distance
    for axis in (0, 1):
        other, there = np.roll(label, 1, axis), np.roll(nearness, 1, axis)
        jump = (other != label) | (np.abs(there - nearness) > 0.2 * np.maximum(there, nearness))
        edge |= jump | np.roll(jump, -1, axis)
    return cv2.dilate(edge.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0


def compare(shot: RenderedImage, instances: NDArray[np.uint16], geom: NDArray[np.int32], distance: NDArray[np.float64]) -> Agreement:
    """Compare a rendered image with the rays of `cast`. instances: (ngeom,)."""
    truth = np.where(geom < 0, 0, instances[geom])
    right = truth == shot.instances
    away = ~silhouettes(geom, distance)
    hit = away & np.isfinite(distance)
    error = np.abs(shot.range[hit] - distance[hit]) / distance[hit]
    return Agreement(float(right.mean()), float(right[away].mean()), float(away.mean()), float(np.median(error)), float(np.percentile(error, 99)))
