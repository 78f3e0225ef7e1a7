"""Panoramic cameras, whose columns span a full turn: the equirectangular panorama and the cylinder. Pixel centres lie at +½."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from tracker.geometry.arrays import Array, Mask
from tracker.geometry.camera_protocol import check_size
from tracker.geometry.poses import angles_from_bearing, bearing_from_angles


@dataclass(frozen=True)
class PanoramicCamera(ABC):
    """A camera with azimuth = π − 2πu/W, so that the middle of the image looks forward, and with the elevation as a function of the row."""

    width: int
    height: int

    def __post_init__(self) -> None:
        check_size(self.width, self.height)

    @property
    def pixel_centre(self) -> float:
        return 0.5

    @property
    def wraps(self) -> bool:
        return True

    def blind(self, pixels: ArrayLike) -> Mask:
        return np.zeros(len(np.asarray(pixels)), dtype=np.bool_)

    @abstractmethod
    def elevations_from_rows(self, rows: Array) -> Array:
        """Rows v (n,) → elevations (n,) rad."""

    @abstractmethod
    def rows_from_elevations(self, elevations: Array) -> Array:
        """Elevations (n,) rad → rows v (n,)."""

    def edges_from_spans(self, elevation: Array, rise: Array) -> tuple[Array, Array]:
        """Rows of the upper edge (n,) and heights (n,) px of spans with the middle at `elevation` (n,) rad that are `rise` (n,) rad high."""
        top, bottom = self.rows_from_elevations(elevation + rise / 2), self.rows_from_elevations(elevation - rise / 2)
        return top, np.asarray(bottom - top)

    def bearings_from_pixels(self, pixels: ArrayLike) -> Array:
        p = np.asarray(pixels, dtype=np.float64)
        return bearing_from_angles(np.pi - 2 * np.pi * p[:, 0] / self.width, self.elevations_from_rows(p[:, 1]))

    @abstractmethod
    def pixels_from_bearings(self, bearings: ArrayLike) -> tuple[Array, Mask]: ...

    def _columns(self, azimuth: Array) -> Array:
        """Azimuths (n,) rad → columns u (n,) in [0, W)."""
        return np.asarray(np.mod((np.pi - azimuth) * self.width / (2 * np.pi), self.width))


@dataclass(frozen=True)
class Panorama(PanoramicCamera):
    """An equirectangular camera, width = 2 height: azimuth = π − 2πu/W, elevation = π/2 − πv/H. The middle of the image looks forward.

    Raises ValueError for another ratio of width and height.
    """

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.width != 2 * self.height:
            raise ValueError(f"panorama is {self.width} x {self.height}, needs width = 2 height")

    def elevations_from_rows(self, rows: Array) -> Array:
        return np.asarray(np.pi / 2 - np.pi * rows / self.height)

    def rows_from_elevations(self, elevations: Array) -> Array:
        return np.asarray((np.pi / 2 - elevations) * self.height / np.pi)

    def edges_from_spans(self, elevation: Array, rise: Array) -> tuple[Array, Array]:
        per_radian = self.height / np.pi
        return np.asarray((np.pi / 2 - elevation - rise / 2) * per_radian), np.asarray(rise * per_radian)

    def pixels_from_bearings(self, bearings: ArrayLike) -> tuple[Array, Mask]:
        azimuth, elevation = angles_from_bearing(bearings)
        u = self._columns(azimuth)
        return np.stack([u, self.rows_from_elevations(elevation)], axis=1), np.ones(len(u), dtype=bool)


@dataclass(frozen=True)
class Cylinder(PanoramicCamera):
    """A cylinder around the vertical axis: azimuth = π − 2πu/W, v = horizon + focal · tan(−elevation).

    horizon: row of elevation 0, px. focal: radius of the cylinder along the rows, px. With square pixels it is W / 2π.
    Vertical directions have no pixel: they are NaN. Raises ValueError for a horizon that is not finite and for a focal that is not above 0.
    """

    horizon: float
    focal: float

    def __post_init__(self) -> None:
        super().__post_init__()
        if not np.isfinite(self.horizon):
            raise ValueError(f"horizon is {self.horizon}, needs a finite number")
        if not 0 < self.focal < np.inf:
            raise ValueError(f"focal is {self.focal}, needs more than 0")

    def elevations_from_rows(self, rows: Array) -> Array:
        return np.asarray(np.arctan2(self.horizon - rows, self.focal))

    def rows_from_elevations(self, elevations: Array) -> Array:
        return np.asarray(self.horizon - self.focal * np.tan(elevations))

    def pixels_from_bearings(self, bearings: ArrayLike) -> tuple[Array, Mask]:
        b = np.asarray(bearings, dtype=np.float64)
        level = np.hypot(b[:, 0], b[:, 1])
        known = level > 1e-9 * np.abs(b[:, 2])
        slope = b[:, 2] / np.where(known, level, 1.0)
        pixels = np.stack([self._columns(np.arctan2(b[:, 1], b[:, 0])), self.horizon - self.focal * slope], axis=1)
        pixels[~known] = np.nan
        with np.errstate(invalid="ignore"):
            inside = known & (pixels[:, 1] >= 0) & (pixels[:, 1] <= self.height)
        return pixels, np.asarray(inside)
