"""How far the pixels of a camera are from the optical axis, which decides what a lens does to them."""

from __future__ import annotations

from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from tracker.geometry.cameras import Camera


class OpticalField:
    """The field of a camera: angle from the optical axis over the largest angle in the image.

    A panoramic camera counts as two lenses, forward and backward, whose fields end at 90° from their axes.
    radius (H, W): from 0 on the axis to 1 at the border of the field.
    """

    def __init__(self, camera: Camera) -> None:
        self.wraps = camera.wraps
        u, v = np.meshgrid(np.arange(camera.width) + camera.pixel_centre, np.arange(camera.height) + camera.pixel_centre)
        pixels = np.stack([u.ravel(), v.ravel()], axis=1)
        ahead = np.clip(camera.bearings_from_pixels(pixels)[:, 0], -1.0, 1.0)
        angle = np.arccos(np.abs(ahead) if camera.wraps else ahead)
        blind = camera.blind(pixels)
        farthest = np.pi / 2 if camera.wraps else float(angle[~blind].max())
        self.radius: NDArray[np.float32] = np.minimum(angle / farthest, 1.0).astype(np.float32).reshape(camera.height, camera.width)

    def attenuation(self, stops: float) -> NDArray[np.float32]:
        """Share (H, W, 1) of the light that a vignette of so many stops leaves."""
        return np.exp2(np.float32(-stops) * self.radius**2)[..., None]

    @cached_property
    def _outward(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Columns and rows (H, W) of the shift of 1 px at the border of the field, away from the axis."""
        radius = np.pad(self.radius, ((1, 1), (1, 1)), "edge")
        if self.wraps:
            radius[:, 0], radius[:, -1] = radius[:, -2], radius[:, 1]
        across, down = radius[1:-1, 2:] - radius[1:-1, :-2], radius[2:, 1:-1] - radius[:-2, 1:-1]
        length = np.maximum(np.hypot(across, down), np.float32(1e-12))
        return self.radius * across / length, self.radius * down / length

    def shifted(self, image: NDArray[np.float32], shift: float) -> NDArray[np.float32]:
        """An image (H, W) whose content lies farther from the axis, by `shift` px at the border of the field and less towards the axis."""
        height, width = image.shape
        v, u = np.mgrid[:height, :width].astype(np.float32)
        across, down = self._outward
        u, v = u - np.float32(shift) * across, v - np.float32(shift) * down
        if self.wraps:
            pad = int(np.ceil(abs(shift))) + 1
            image, u = np.concatenate([image[:, -pad:], image, image[:, :pad]], axis=1), u + np.float32(pad)
        return np.asarray(cv2.remap(image, u, v, interpolation=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE), dtype=np.float32)
