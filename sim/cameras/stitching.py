"""Stitching of two fisheye pictures into a panorama: which lens a pixel takes, in which direction, and how the two are blended.

A pixel's direction is that from the middle between the lenses to a point at the stitching distance. Each lens sees that point in its own direction.
So the two pictures agree at that distance, and have parallax at any other.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from tracker.geometry import Array, Mask, Pose
from tracker.geometry.cameras import Fisheye, Panorama


@dataclass(frozen=True, eq=False)
class Stitching:
    """How a panorama is made of the pictures of two lenses, forward and backward.

    T_rig_lens: poses of the lenses; the panorama's frame is that of the rig. distance: m, of the surface on which the pictures agree.
    feather: rad, the width of the zone around the seam in which they are blended.
    believed: the lens model that stitching assumes; None where it is the true lens.
    """

    panorama: Panorama
    lens: Fisheye
    T_rig_lens: tuple[Pose, Pose]
    distance: float
    feather: float
    believed: Fisheye | None = None

    @cached_property
    def halves(self) -> tuple[HalfPanorama, HalfPanorama]:
        """What the lenses contribute to the truth of the panorama: a hemisphere each."""
        return HalfPanorama(self, 0), HalfPanorama(self, 1)

    def lens_bearings(self, bearings: Array, index: int) -> Array:
        """Unit directions (n, 3) in the lens' frame of the points at the stitching distance in the directions (n, 3) of the rig."""
        towards = self.T_rig_lens[index].inverse().apply(self.distance * bearings)
        return np.asarray(towards / np.linalg.norm(towards, axis=1, keepdims=True))

    def weights(self, bearings: Array) -> Array:
        """The forward lens' share (n,) of the light of a pixel: 1 ahead, 0 behind, linear in the angle from the seam within the feather zone."""
        from_seam = np.arcsin(np.clip(bearings[:, 0], -1.0, 1.0))
        if self.feather == 0:
            return np.where(from_seam >= 0, 1.0, 0.0)
        return np.asarray(np.clip(0.5 + from_seam / self.feather, 0.0, 1.0))

    @cached_property
    def _maps(self) -> tuple[tuple[NDArray[np.float32], NDArray[np.float32]], ...]:
        """For each lens the columns and rows (H, W) of its picture that the pixels take, its first pixel's centre at (0, 0)."""
        found, shape = [], (self.panorama.height, self.panorama.width)
        for index in (0, 1):
            pixels, _ = (self.believed or self.lens).pixels_from_bearings(self.lens_bearings(self._bearings, index))
            u, v = np.nan_to_num(pixels, nan=-9.0).astype(np.float32).T
            found.append((np.ascontiguousarray(u.reshape(shape)), np.ascontiguousarray(v.reshape(shape))))
        return tuple(found)

    @cached_property
    def _bearings(self) -> Array:
        u, v = np.meshgrid(np.arange(self.panorama.width) + 0.5, np.arange(self.panorama.height) + 0.5)
        return self.panorama.bearings_from_pixels(np.stack([u.ravel(), v.ravel()], axis=1))

    @cached_property
    def _share(self) -> NDArray[np.float32]:
        return self.weights(self._bearings).reshape(self.panorama.height, self.panorama.width, 1).astype(np.float32)

    def lens_rows(self, index: int) -> NDArray[np.float32]:
        """The row (H, W) of the picture of lens `index` that each pixel of the panorama takes; outside of the picture where it takes none."""
        return self._maps[index][1]

    def stitched(self, pictures: tuple[NDArray[np.uint8], NDArray[np.uint8]]) -> NDArray[np.uint8]:
        """The panorama (H, W, 3) of the pictures (side, side, 3) of the lenses, sampled bilinearly and blended."""
        front, back = (
            cv2.remap(picture, *maps, interpolation=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE).astype(np.float32)
            for picture, maps in zip(pictures, self._maps, strict=True)
        )
        return np.asarray(np.rint(back + self._share * (front - back)), dtype=np.uint8)


@dataclass(frozen=True, eq=False)
class HalfPanorama:
    """The pixels of a stitched panorama that one lens owns, as a camera at the place of that lens; all others are blind.

    A pixel belongs to the lens with the larger share of its light: the forward one where x ≥ 0. Bearings are in the lens' frame.
    """

    stitching: Stitching
    index: int

    @property
    def width(self) -> int:
        return self.stitching.panorama.width

    @property
    def height(self) -> int:
        return self.stitching.panorama.height

    @property
    def pixel_centre(self) -> float:
        return 0.5

    @property
    def wraps(self) -> bool:
        return True

    def bearings_from_pixels(self, pixels: ArrayLike) -> Array:
        stitching = self.stitching
        towards = stitching.lens_bearings(stitching.panorama.bearings_from_pixels(pixels), self.index)
        if stitching.believed is None:
            return towards
        return _through(stitching.believed, stitching.lens, towards)

    def pixels_from_bearings(self, bearings: ArrayLike) -> tuple[Array, Mask]:
        """Pixels (n, 2) of directions in the lens' frame: of the points where they meet the sphere of the stitching distance."""
        T = self.stitching.T_rig_lens[self.index]
        if self.stitching.believed is not None:
            bearings = _through(self.stitching.lens, self.stitching.believed, np.asarray(bearings, dtype=np.float64))
        direction = np.asarray(bearings, dtype=np.float64) @ T.rotation.T
        direction = direction / np.linalg.norm(direction, axis=1, keepdims=True)
        along = direction @ T.translation
        reach = -along + np.sqrt(along**2 + self.stitching.distance**2 - T.translation @ T.translation)
        points = T.translation + reach[:, None] * direction
        pixels, _ = self.stitching.panorama.pixels_from_bearings(points)
        return pixels, ~self.blind(pixels)

    def blind(self, pixels: ArrayLike) -> Mask:
        forward = self.stitching.panorama.bearings_from_pixels(pixels)[:, 0] >= 0
        return np.asarray(forward != (self.index == 0))


def _through(one: Fisheye, other: Fisheye, bearings: Array) -> Array:
    """Directions (n, 3) in lens `other` of the pixels in which lens `one` sees `bearings` (n, 3). Directions that `one` does not see are kept."""
    pixels, known = one.pixels_from_bearings(bearings)
    out = np.array(bearings)
    out[known] = other.bearings_from_pixels(pixels[known])
    return out
