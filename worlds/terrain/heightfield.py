"""Terrain as heights in metres on a square grid, the same surface that MuJoCo renders and collides with."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from worlds.engine import mujoco

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

# Depth of the solid below the lowest height, m: objects that have sunk this far have fallen through.
BASE_DEPTH = 1.0


@dataclass(frozen=True, eq=False)
class Heightfield:
    """Heights (rows, columns) m: row 0 at the lowest y, column 0 at the lowest x; origin (2,) m, the lowest x, y; spacing m.

    Between grid points each cell is two triangles, split along (i, j) → (i+1, j+1), as in MuJoCo's height field.
    Raises ValueError for fewer than 2 x 2 heights, heights that are not finite or a spacing that is not above 0.
    """

    heights: Array
    origin: Array
    spacing: float

    def __post_init__(self) -> None:
        heights, origin = np.array(self.heights, dtype=np.float64), np.array(self.origin, dtype=np.float64)
        if heights.ndim != 2 or min(heights.shape) < 2:
            raise ValueError(f"heights have shape {heights.shape}, need at least (2, 2)")
        if origin.shape != (2,):
            raise ValueError(f"origin has shape {origin.shape}, needs (2,)")
        if not (np.isfinite(heights).all() and np.isfinite(origin).all()):
            raise ValueError("heights or origin are not finite")
        if not self.spacing > 0:
            raise ValueError(f"spacing is {self.spacing} m, needs more than 0")
        heights.flags.writeable = origin.flags.writeable = False
        object.__setattr__(self, "heights", heights)
        object.__setattr__(self, "origin", origin)

    @staticmethod
    def flat(extent: ArrayLike, spacing: float) -> Heightfield:
        """Level ground at 0 m over extent [[xmin, ymin], [xmax, ymax]] m, a whole number of cells that covers it."""
        low, high = np.asarray(extent, dtype=np.float64)
        columns, rows = np.ceil((high - low) / spacing - 1e-9).astype(int) + 1
        return Heightfield(np.zeros((rows, columns)), low, spacing)

    def with_heights(self, heights: ArrayLike) -> Heightfield:
        """The same grid with other heights (rows, columns) m."""
        return Heightfield(np.broadcast_to(np.asarray(heights, dtype=np.float64), self.heights.shape), self.origin, self.spacing)

    @property
    def x(self) -> Array:
        """(columns,) m: x of each column."""
        return self.origin[0] + self.spacing * np.arange(self.heights.shape[1])

    @property
    def y(self) -> Array:
        """(rows,) m: y of each row."""
        return self.origin[1] + self.spacing * np.arange(self.heights.shape[0])

    @property
    def nodes(self) -> Array:
        """(rows, columns, 2) m: x, y of each grid point."""
        return np.stack(np.meshgrid(self.x, self.y), axis=-1)

    @property
    def extent(self) -> Array:
        """[[xmin, ymin], [xmax, ymax]] m."""
        rows, columns = self.heights.shape
        return np.array([self.origin, self.origin + self.spacing * np.array([columns - 1, rows - 1])])

    @property
    def slope(self) -> Array:
        """(rows, columns) rad: the steepest of the triangles that meet in each grid point."""
        z = self.heights
        east, north = np.diff(z, axis=1) / self.spacing, np.diff(z, axis=0) / self.spacing
        steepest = np.maximum(np.hypot(east[:-1], north[:, 1:]), np.hypot(east[1:], north[:, :-1]))
        around = np.pad(steepest, 1)
        corners = [around[:-1, :-1], around[:-1, 1:], around[1:, :-1], around[1:, 1:]]
        return np.arctan(np.maximum.reduce(corners))

    @property
    def rise(self) -> Array:
        """(rows, columns) m: the largest difference of height from each grid point to one of its four neighbours."""
        out = np.zeros_like(self.heights)
        for z, rise in ((self.heights, out), (self.heights.T, out.T)):
            step = np.abs(np.diff(z, axis=0))
            rise[:-1] = np.maximum(rise[:-1], step)
            rise[1:] = np.maximum(rise[1:], step)
        return out

    def height_at(self, points: ArrayLike) -> Array:
        """(n, 2 or more) x, y m → (n,) heights m; outside of the grid, those at the nearest points of its edge."""
        # One kind of array, read-only and contiguous, so that the kernel is compiled once.
        places = np.ascontiguousarray(points, dtype=np.float64).view()
        places.flags.writeable = False
        return _interpolated(self.heights, self.origin, self.spacing, places)

    def lowest_around(self, place: ArrayLike, radius: float) -> float:
        """m: the lowest of the heights at place (2,) m and at four points around it, radius m away."""
        ring = np.asarray(place) + radius * np.array([(0, 0), (1, 0), (0, 1), (-1, 0), (0, -1)])
        return float(self.height_at(ring).min())

    def normal_at(self, points: ArrayLike) -> Array:
        """(n, 2 or more) x, y m → (n, 3) upward unit normals of the triangles; outside of the grid, those at the nearest points of its edge."""
        u, v, z00, z01, z10, z11 = self._cells(points)
        east = np.where(u >= v, z01 - z00, z11 - z10) / self.spacing
        north = np.where(u >= v, z11 - z01, z10 - z00) / self.spacing
        normal = np.stack([-east, -north, np.ones_like(east)], axis=1)
        return normal / np.linalg.norm(normal, axis=1, keepdims=True)

    def _cells(self, points: ArrayLike) -> tuple[Array, ...]:
        """Each point's place (u, v) in [0, 1]² in its cell, and the cell's heights z[row][column], (n,) each."""
        rows, columns = self.heights.shape
        p = np.clip((np.asarray(points, dtype=np.float64)[:, :2] - self.origin) / self.spacing, 0.0, [columns - 1, rows - 1])
        cell = np.minimum(p.astype(np.int64), [columns - 2, rows - 2])
        u, v = (p - cell).T
        j, i = cell.T
        z = self.heights
        return u, v, z[i, j], z[i, j + 1], z[i + 1, j], z[i + 1, j + 1]

    def add_to(self, spec: mujoco.MjSpec, name: str, material: str = "") -> mujoco.MjsGeom:
        """The terrain as a height field and a geom of that name in the world body of `spec`; returns the geom.

        MuJoCo rescales heights to [0, 1] when it compiles, so the range goes into the size and the lowest height into the position.
        """
        low, high = float(self.heights.min()), float(self.heights.max())
        span = high - low
        # A flat field has no range to rescale by: all its data is 0, and its size must only be above 0.
        unit, size = ((self.heights - low) / span, span) if span > 1e-9 else (np.zeros_like(self.heights), 1e-3)
        rows, columns = self.heights.shape
        corner, opposite = self.extent
        half = (opposite - corner) / 2
        spec.add_hfield(name=name, nrow=rows, ncol=columns, size=[*half, size, BASE_DEPTH], userdata=unit.ravel().astype(np.float32))
        centre = (corner + opposite) / 2
        return spec.worldbody.add_geom(name=name, type=mujoco.mjtGeom.mjGEOM_HFIELD, hfieldname=name, pos=[*centre, low], material=material, group=0)


@njit(cache=True)
def _interpolated(z: Array, origin: Array, spacing: float, points: Array) -> Array:
    """Heights z (rows, columns) at points (n, 2 or more), on the two triangles of each cell."""
    rows, columns = z.shape
    out = np.empty(len(points))
    for k in range(len(points)):
        if math.isnan(points[k, 0] + points[k, 1]):
            out[k] = np.nan
            continue
        x = min(max((points[k, 0] - origin[0]) / spacing, 0.0), columns - 1.0)
        y = min(max((points[k, 1] - origin[1]) / spacing, 0.0), rows - 1.0)
        j, i = min(int(x), columns - 2), min(int(y), rows - 2)
        u, v = x - j, y - i
        z00, z01, z10, z11 = z[i, j], z[i, j + 1], z[i + 1, j], z[i + 1, j + 1]
        out[k] = z00 + u * (z01 - z00) + v * (z11 - z01) if u >= v else z00 + v * (z10 - z00) + u * (z11 - z10)
    return out
