"""Terrain as a plane or a height map: heights under points, and intersections of rays with the ground."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike

from tracker.geometry.arrays import Array, Mask, frozen
from tracker.geometry.compilation import njit


class Ground(Protocol):
    """Terrain as a height over the plane."""

    def __hash__(self) -> int: ...

    def height_at(self, points: ArrayLike) -> Array:
        """(n, 2 or more) x, y m → (n,) heights m; the nearest known height outside."""
        ...

    def intersect(self, origins: ArrayLike, directions: ArrayLike, limit: float) -> tuple[Array, Mask]:
        """Rays from (n, 3) m along unit (n, 3) → first points on the ground (n, 3) m and whether there is one within `limit` m."""
        ...


@dataclass(frozen=True)
class Flat:
    """The plane z = level."""

    level: float = 0.0

    def height_at(self, points: ArrayLike) -> Array:
        return np.full(len(np.asarray(points)), self.level)

    def intersect(self, origins: ArrayLike, directions: ArrayLike, limit: float) -> tuple[Array, Mask]:
        o, d = np.asarray(origins, dtype=np.float64), np.asarray(directions, dtype=np.float64)
        down = np.where(np.abs(d[:, 2]) > 1e-12, d[:, 2], np.inf)
        t = (self.level - o[:, 2]) / down
        hit = (t > 0) & (t <= limit) & np.isfinite(down)
        return o + np.where(hit, t, 0.0)[:, None] * d, hit


@dataclass(frozen=True, eq=False)
class Grid:
    """Heights (rows, columns) m on a square grid: row 0 at the lowest y, column 0 at the lowest x; origin (2,) m; spacing m.

    Between grid points each cell is two triangles, split along (i, j) → (i+1, j+1), as MuJoCo's height field has it.
    """

    heights: Array
    origin: Array
    spacing: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "heights", frozen(self.heights, (None, None), "heights"))
        object.__setattr__(self, "origin", frozen(self.origin, (2,), "origin"))
        if not self.spacing > 0 or min(self.heights.shape) < 2:
            raise ValueError(f"grid {self.heights.shape} with spacing {self.spacing} m, needs at least 2 x 2 and more than 0 m")

    def height_at(self, points: ArrayLike) -> Array:
        p = (np.asarray(points, dtype=np.float64)[:, :2] - self.origin) / self.spacing
        rows, columns = self.heights.shape
        p = np.clip(p, 0.0, [columns - 1, rows - 1])
        i = np.minimum(p.astype(np.int64), [columns - 2, rows - 2])
        u, v = (p - i).T
        j, i = i.T
        z = self.heights
        z00, z01, z10, z11 = z[i, j], z[i, j + 1], z[i + 1, j], z[i + 1, j + 1]
        return np.where(u >= v, z00 + u * (z01 - z00) + v * (z11 - z01), z00 + v * (z10 - z00) + u * (z11 - z10))

    def intersect(self, origins: ArrayLike, directions: ArrayLike, limit: float) -> tuple[Array, Mask]:
        """The exact first intersection, found by stepping along the edges of the triangles: between two edges the height above ground is linear.

        A ray that begins on or under the ground meets it at its origin, unless it is above the ground at the next edge.
        Raises ValueError for a limit that is not finite.
        """
        if not np.isfinite(limit):
            raise ValueError(f"limit is {limit} m, needs to be finite")
        o, d = (np.ascontiguousarray(v, dtype=np.float64).view() for v in (origins, directions))
        # One kind of array, so that the kernel is compiled once.
        o.flags.writeable = d.flags.writeable = False
        distance = _march(self.heights, self.origin, self.spacing, float(self.heights.max()) + 1e-6, o, d, float(limit))
        hit = distance >= 0
        return o + np.where(hit, distance, 0.0)[:, None] * d, hit


@njit(cache=True)
def _height(heights: Array, spacing: float, x: float, y: float) -> Any:
    """The height at x, y m from the grid's first point."""
    rows, columns = heights.shape
    x, y = min(max(x / spacing, 0.0), columns - 1.0), min(max(y / spacing, 0.0), rows - 1.0)
    j, i = min(int(x), columns - 2), min(int(y), rows - 2)
    u, v = x - j, y - i
    z00, z11 = heights[i, j], heights[i + 1, j + 1]
    if u >= v:
        return z00 + u * (heights[i, j + 1] - z00) + v * (z11 - heights[i, j + 1])
    return z00 + v * (heights[i + 1, j] - z00) + u * (z11 - heights[i + 1, j])


@njit(cache=True)
def _march(heights: Array, origin: Array, spacing: float, top: float, origins: Array, directions: Array, limit: float) -> Array:
    """Distance along each ray (n,) m to the ground, −1 where the ray does not meet it.

    A ray steps over the lines x whole, y whole and x − y whole (the diagonals) of a grid with unit cells.
    """
    out = np.full(len(origins), -1.0)
    start, rate, line = np.empty(3), np.empty(3), np.empty(3)
    for n in range(len(origins)):
        ox, oy, oz = origins[n, 0] - origin[0], origins[n, 1] - origin[1], origins[n, 2]
        dx, dy, dz = directions[n]
        # A ray above the highest point of the grid cannot touch the ground before it descends to that height.
        low = (oz - top) / max(-dz, 1e-12) if oz > top and dz < 0 else 0.0
        if low >= limit:
            continue
        start[0], start[1], start[2] = ox / spacing, oy / spacing, (ox - oy) / spacing
        rate[0], rate[1], rate[2] = dx / spacing, dy / spacing, (dx - dy) / spacing
        for axis in range(3):
            at = start[axis] + low * rate[axis]
            line[axis] = np.floor(at) + 1 if rate[axis] > 0 else np.ceil(at) - 1
        clearance = oz + low * dz - _height(heights, spacing, ox + low * dx, oy + low * dy)
        high = low
        while high < limit:
            nearest, high = 0, np.inf
            for axis in range(3):
                if abs(rate[axis]) > 1e-12:
                    distance = (line[axis] - start[axis]) / rate[axis]
                    if distance < high:
                        nearest, high = axis, distance
            line[nearest] += 1.0 if rate[nearest] > 0 else -1.0
            high = min(high, limit)
            z = oz + high * dz
            following = z - _height(heights, spacing, ox + high * dx, oy + high * dy)
            if following <= 0:
                # Linear interpolation between the heights above ground at both edges.
                before = max(clearance, 0.0)
                out[n] = low + before / max(before - following, 1e-300) * (high - low)
                break
            if dz >= 0 and z > top:
                break
            low, clearance = high, following
    return out
