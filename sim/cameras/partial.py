"""Some pixels of a camera as a camera of its own: rows that are read out together, or the part that one lens owns."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tracker.geometry import Array, Mask
from tracker.geometry.cameras import Camera


@dataclass(frozen=True, eq=False)
class PartialCamera:
    """The pixels of a camera where a mask is set, cropped to the rectangle around them; other pixels are blind.

    base: any camera. left, top: the first column and row of the rectangle. seen (height, width): the mask in the rectangle, read-only.
    """

    base: Camera
    left: int
    top: int
    seen: NDArray[np.bool_]

    @staticmethod
    def of(base: Camera, mask: NDArray[np.bool_]) -> PartialCamera:
        """The pixels of `base` where the mask (H, W) is True. Raises ValueError for an empty mask."""
        rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
        if not len(rows):
            raise ValueError("mask is empty, needs a pixel")
        seen = mask[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1].copy()
        seen.flags.writeable = False
        return PartialCamera(base, int(columns[0]), int(rows[0]), seen)

    @property
    def width(self) -> int:
        return int(self.seen.shape[1])

    @property
    def height(self) -> int:
        return int(self.seen.shape[0])

    @property
    def pixel_centre(self) -> float:
        return self.base.pixel_centre

    @property
    def wraps(self) -> bool:
        return self.base.wraps and self.width == self.base.width

    @property
    def _corner(self) -> Array:
        return np.array([self.left, self.top], dtype=np.float64)

    def paste(self, part: NDArray[np.generic], whole: NDArray[np.generic]) -> None:
        """Copy the pixels of this camera's image (height, width, …) to their places in the base's image."""
        target = whole[self.top : self.top + self.height, self.left : self.left + self.width]
        target[self.seen] = part[self.seen]

    def bearings_from_pixels(self, pixels: ArrayLike) -> Array:
        return self.base.bearings_from_pixels(np.asarray(pixels, dtype=np.float64) + self._corner)

    def pixels_from_bearings(self, bearings: ArrayLike) -> tuple[Array, Mask]:
        pixels, seen = self.base.pixels_from_bearings(bearings)
        pixels = pixels - self._corner
        with np.errstate(invalid="ignore"):
            inside = seen & ~self._outside(pixels)
        return pixels, inside

    def blind(self, pixels: ArrayLike) -> Mask:
        p = np.asarray(pixels, dtype=np.float64)
        return self.base.blind(p + self._corner) | self._outside(p)

    def _outside(self, pixels: Array) -> Mask:
        index = np.floor(np.nan_to_num(pixels, nan=-9.0) + (0.5 - self.pixel_centre)).astype(np.int64)
        inside = ((index >= 0) & (index < [self.width, self.height])).all(axis=1)
        out = np.ones(len(index), dtype=np.bool_)
        out[inside] = ~self.seen[index[inside, 1], index[inside, 0]]
        return out
