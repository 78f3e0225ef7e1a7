"""Perspective views resampled from panoramas: the image of a level pinhole camera at the same position.

The panorama of a robot on a slope is tilted, and the view is not. Both have the same centre, so only directions change.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from tracker.geometry import Pose, rotation_z
from tracker.geometry.cameras import Panorama, Tsai, pinhole


@dataclass(frozen=True)
class ViewDirection:
    """The direction of a view: azimuth rad in the world, horizontal field of view rad, and its size width, height px."""

    azimuth: float
    field: float
    size: tuple[int, int]


@dataclass(frozen=True, eq=False)
class PerspectiveView:
    """A view: its camera (κ1 = 0, sx = 1), T_world_camera with the horizon level, and the panorama's pixels u, v (H, W) under its own."""

    camera: Tsai
    T_world_camera: Pose
    u: NDArray[np.float32]
    v: NDArray[np.float32]

    def colour(self, image: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Panorama (H, W, 3) → view, bilinear, across the seam too."""
        self._check(image)
        # One column more on either side, so that interpolation goes over the seam.
        wide = np.concatenate([image[:, -1:], image, image[:, :1]], axis=1)
        mode = cv2.BORDER_REPLICATE
        return np.asarray(cv2.remap(wide, self.u + 0.5, self.v - 0.5, cv2.INTER_LINEAR, borderMode=mode), dtype=np.uint8)

    def nearest(self, values: NDArray[Any]) -> NDArray[Any]:
        """Instances, classes or range along the ray (H, W) of the panorama → those of the view, the nearest pixel's."""
        self._check(values)
        height, width = values.shape[:2]
        rows = np.clip(np.floor(self.v).astype(np.int64), 0, height - 1)
        return values[rows, np.floor(self.u).astype(np.int64) % width]

    def _check(self, image: NDArray[Any]) -> None:
        if image.shape[1] != 2 * image.shape[0] or not self.u.max() <= image.shape[1]:
            raise ValueError(f"panorama is {image.shape[1]} x {image.shape[0]} px, needs the size that the view was made for")


def rectify(panorama: Panorama, T_world_camera: Pose, direction: ViewDirection) -> PerspectiveView:
    """The view of a panorama at T_world_camera in the direction of the direction. Raises ValueError for a field of view not within (0, π)."""
    width, height = direction.size
    camera = pinhole(width, height, direction.field)
    T_world_view = Pose(rotation_z(direction.azimuth), T_world_camera.translation)
    u, v = np.meshgrid(np.arange(width, dtype=np.float64), np.arange(height, dtype=np.float64))
    bearings = camera.bearings_from_pixels(np.stack([u.ravel(), v.ravel()], axis=1))
    pixels, _ = panorama.pixels_from_bearings(bearings @ T_world_view.rotation.T @ T_world_camera.rotation)
    maps = [pixels[:, k].reshape(height, width).astype(np.float32) for k in (0, 1)]
    for array in maps:
        array.flags.writeable = False
    return PerspectiveView(camera, T_world_view, *maps)
