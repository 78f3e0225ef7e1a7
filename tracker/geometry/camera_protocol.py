"""The interface of a camera, the optical frame, and the check of an image's size.

The frame of a camera is that of a body: x forward, y left, z up. Only pinhole and fisheye models use the optical frame (x right, y down, z forward).
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from tracker.geometry.arrays import Array, Mask

OPTICAL_FROM_CAMERA = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])

OPTICAL_FROM_CAMERA.flags.writeable = False

MAX_SIDE = 1 << 15
"""px. A larger image, claimed by a file of unknown origin, would exhaust the memory."""


class Camera(Protocol):
    """The interface of a camera. Bearings are unit directions in the camera's frame."""

    @property
    def width(self) -> int: ...

    @property
    def height(self) -> int: ...

    @property
    def pixel_centre(self) -> float:
        """u and v of the centre of the first pixel: ½, or 0 where centres lie at whole numbers."""
        ...

    @property
    def wraps(self) -> bool:
        """Whether the left edge of the image continues its right edge. The columns then span a full turn: azimuth = π − 2πu/W."""
        ...

    def bearings_from_pixels(self, pixels: ArrayLike) -> Array:
        """(n, 2) pixels u, v → (n, 3) unit directions, finite also for pixels outside the image and for blind pixels."""
        ...

    def pixels_from_bearings(self, bearings: ArrayLike) -> tuple[Array, Mask]:
        """(n, 3) directions → (n, 2) pixels and whether each lies in the image; pixels out of view may be NaN."""
        ...

    def blind(self, pixels: ArrayLike) -> Mask:
        """(n, 2) pixels → (n,) whether no direction projects to each pixel, for instance outside the round image of a fisheye lens."""
        ...


def check_size(width: int, height: int) -> None:
    """Raises ValueError for an image without pixels, or with more than MAX_SIDE a side."""
    if not (isinstance(width, int | np.integer) and isinstance(height, int | np.integer)):
        raise ValueError(f"image size is {str(width)[:40]} x {str(height)[:40]}, needs whole numbers")
    if not (1 <= width <= MAX_SIDE and 1 <= height <= MAX_SIDE):
        raise ValueError(f"image size is {width} x {height}, needs at least 1 x 1 and at most {MAX_SIDE} a side")
