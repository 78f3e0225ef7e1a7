"""Images resampled into another camera with the same centre, and the six faces of a cube around a panoramic camera."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from tracker.geometry.arrays import Array
from tracker.geometry.camera_protocol import Camera
from tracker.geometry.lenses import Pinhole
from tracker.geometry.panoramas import PanoramicCamera
from tracker.geometry.poses import rotation_z

_UP = np.array([[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])
FACES: dict[str, Array] = {
    "front": rotation_z(0.0),
    "left": rotation_z(np.pi / 2).round(),
    "back": rotation_z(np.pi).round(),
    "right": rotation_z(-np.pi / 2).round(),
    "up": _UP,
    "down": _UP.T,
}
"""Name of a face → R_camera_face (3, 3), both frames x forward, y left, z up. The left of `up` and `down` is the left of the camera."""
FARTHEST_OUT = -9.0
"""px: source column and row of a pixel that sees nothing of the source. It is beyond the border, which is black."""


def face_camera(camera: PanoramicCamera) -> Pinhole:
    """The pinhole of a face: 90° in both directions, with the panorama's pixels per radian in its middle (rounded to an even side)."""
    side = max(2 * round(camera.width / (2 * np.pi)), 2)
    return Pinhole(side, side, side / 2, side / 2, (side - 1) / 2, (side - 1) / 2)


@dataclass(frozen=True, eq=False)
class Resampling:
    """Makes the image of `target` from that of `source`, two cameras with one centre. R_source_target (3, 3): target frame to source frame."""

    source: Camera
    target: Camera
    R_source_target: Array

    @cached_property
    def _map(self) -> NDArray[np.float32]:
        """Column and row of the source, its first pixel's centre at (0, 0), for each pixel of the target: (2, H, W).

        In a source that wraps, columns count from the one that `image` puts before the first.
        """
        shift = self.target.pixel_centre
        u, v = np.meshgrid(np.arange(self.target.width) + shift, np.arange(self.target.height) + shift)
        aim = np.column_stack([u.ravel(), v.ravel()])
        pixels, seen = self.source.pixels_from_bearings(self.target.bearings_from_pixels(aim) @ self.R_source_target.T)
        at = np.where((seen & ~self.target.blind(aim))[:, None], pixels - self.source.pixel_centre, FARTHEST_OUT)
        # Within half a pixel of the border the nearest pixel is taken; over the seam a column of the other side stands beside the border.
        low = np.array([-1.0 if self.source.wraps else 0.0, 0.0])
        high = np.array([self.source.width - (0.0 if self.source.wraps else 1.0), self.source.height - 1.0])
        at = np.where(at > FARTHEST_OUT, np.clip(at, low, high), at)
        if self.source.wraps:
            at = at + np.array([1.0, 0.0])
        return np.ascontiguousarray(at.T.reshape(2, self.target.height, self.target.width), dtype=np.float32)

    def image(self, image: NDArray[Any]) -> NDArray[Any]:
        """The source's image (H, W) or (H, W, 3) → the target's, sampled bilinearly; black where the source sees nothing."""
        if self.source.wraps:
            image = np.concatenate([image[:, -1:], image, image[:, :1]], axis=1)
        u, v = self._map
        return np.asarray(cv2.remap(image, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=0))
