"""Terrain as a plane or a height map: heights under points, and intersections of rays with the ground."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike
from scipy.ndimage import maximum_filter

from tracker.geometry.arrays import Array, Mask, frozen
from tracker.geometry.compilation import njit

BLOCK = 4
"""Cells along each side of a block of a grid, whose highest point tells whether a ray passes over it."""


def inside_area(points: ArrayLike, area: Array | None) -> Mask:
    """Points (n, 2 or more) m → (n,) whether each lies in the area (2, 2) m, lowest and highest x, y, or on its edge.

    Without an area (None), every finite point lies inside. A NaN point never does.
    """
    xy = np.asarray(points, dtype=np.float64)[:, :2]
    inside = np.isfinite(xy) if area is None else (xy >= area[0]) & (xy <= area[1])
    return np.asarray(inside.all(axis=1))


class Ground(Protocol):
    """Terrain as a height over the plane."""

    def __hash__(self) -> int: ...

    def height_at(self, points: ArrayLike) -> Array:
        """(n, 2 or more) x, y m → (n,) heights m; the nearest known height outside."""
        ...

    def intersect(self, origins: ArrayLike, directions: ArrayLike, limit: float, until: Array | None = None) -> tuple[Array, Mask]:
        """Rays from (n, 3) m along unit (n, 3) → first points on the ground (n, 3) m and whether there is one within `limit` m.

        until (n,) m: points farther away than this may be left out, which saves time.
        """
        ...


@dataclass(frozen=True)
class Flat:
    """The plane z = level."""

    level: float = 0.0

    def height_at(self, points: ArrayLike) -> Array:
        return np.full(len(np.asarray(points)), self.level)

    def intersect(self, origins: ArrayLike, directions: ArrayLike, limit: float, until: Array | None = None) -> tuple[Array, Mask]:
        o, d = np.asarray(origins, dtype=np.float64), np.asarray(directions, dtype=np.float64)
        down = np.where(np.abs(d[:, 2]) > 1e-12, d[:, 2], np.inf)
        t = (self.level - o[:, 2]) / down
        hit = (t > 0) & (t <= limit) & np.isfinite(down)
        return o + np.where(hit, t, 0.0)[:, None] * d, hit


@dataclass(frozen=True, eq=False)
class Grid:
    """Heights (rows, columns) m on a square grid: row 0 at the lowest y, column 0 at the lowest x; origin (2,) m; spacing m.

    Between grid points each cell is two triangles, split along (i, j) → (i+1, j+1), as in MuJoCo's height field.
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
        # A copy: the array type is always the same, so that the kernel is compiled once.
        p = np.array(np.asarray(points, dtype=np.float64)[:, :2], order="C")
        return np.asarray(_heights(self.heights, self.origin, self.spacing, p))

    def intersect(self, origins: ArrayLike, directions: ArrayLike, limit: float, until: Array | None = None) -> tuple[Array, Mask]:
        """The exact first intersection, found by stepping from edge to edge of the triangles. Between two edges the height above ground is linear.

        A ray that begins on or under the ground meets it at its origin, unless it is above the ground at the next edge.
        Raises ValueError for a limit that is not finite.
        """
        if not np.isfinite(limit):
            raise ValueError(f"limit is {limit} m, needs to be finite")
        o, d = (np.ascontiguousarray(v, dtype=np.float64).view() for v in (origins, directions))
        # Always read-only: the array type is always the same, so that the kernel is compiled once.
        o.flags.writeable = d.flags.writeable = False
        end = np.full(len(o), float(limit)) if until is None else np.minimum(until, float(limit))
        distance = _march(self.heights, self._peaks, self.origin, self.spacing, o, d, float(limit), end)
        hit = distance >= 0
        return o + np.where(hit, distance, 0.0)[:, None] * d, hit

    @cached_property
    def _peaks(self) -> Array:
        """The highest point of each block of BLOCK² cells and of the cells around it, m."""
        rows, columns = (np.minimum(np.arange(-(-(n - 1) // BLOCK)) * BLOCK + BLOCK // 2, n - 1) for n in self.heights.shape)
        return np.asarray(maximum_filter(self.heights, BLOCK + 3, mode="nearest")[np.ix_(rows, columns)])


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
def _heights(heights: Array, origin: Array, spacing: float, points: Array) -> Array:
    """The heights (n,) at `points` (n, 2) m."""
    out = np.empty(len(points))
    for n in range(len(points)):
        out[n] = _height(heights, spacing, points[n, 0] - origin[0], points[n, 1] - origin[1])
    return out


@njit(cache=True)
def _march(heights: Array, peaks: Array, origin: Array, spacing: float, origins: Array, directions: Array, limit: float, until: Array) -> Array:
    """Distance along each ray (n,) m to the ground, −1 where the ray does not meet it within `limit` m.

    A ray steps from line to line of a grid with unit cells: integer x, integer y and integer x − y (the diagonals). It is followed up to the first
    line at a distance of `until` (n,) m or more; `until` is at most `limit`. A ray skips the blocks whose peak it passes above. This changes no
    result, since `peaks` (Grid._peaks) include the neighbouring cells.
    """
    out, top = np.full(len(origins), -1.0), peaks.max() + 1e-6
    start, rate, line = np.empty(3), np.empty(3), np.empty(3)
    block = np.empty(2, np.int64)
    for n in range(len(origins)):
        ox, oy, oz = origins[n, 0] - origin[0], origins[n, 1] - origin[1], origins[n, 2]
        dx, dy, dz = directions[n]
        # A ray above the highest point of the grid cannot touch the ground before it descends to that height.
        high = (oz - top) / max(-dz, 1e-12) if oz > top and dz < 0 else 0.0
        start[0], start[1], start[2] = ox / spacing, oy / spacing, (ox - oy) / spacing
        rate[0], rate[1], rate[2] = dx / spacing, dy / spacing, (dx - dy) / spacing
        for axis in range(2):
            block[axis] = min(max(int(np.floor((start[axis] + high * rate[axis]) / BLOCK)), 0), peaks.shape[1 - axis] - 1)
        step = 1 / max(abs(rate[0]), abs(rate[1]), 1e-9)  # m, at most, to the next integer x or y
        face, end, landed, clearance = -1, high, True, 0.0
        while True:
            while end <= high < until[n]:
                if face >= 0:
                    block[face] += 1 if rate[face] > 0 else -1
                face, end = 0, np.inf
                for axis in range(2):
                    side = block[axis] + 1 if rate[axis] > 0 else block[axis]
                    if abs(rate[axis]) > 1e-12 and 0 < side < peaks.shape[1 - axis]:
                        distance = (BLOCK * side - start[axis]) / rate[axis]
                        if distance < end:
                            face, end = axis, distance
                last = oz + (min(end, until[n]) + step) * dz
                if end > high and min(oz + high * dz, last) > peaks[block[1], block[0]]:
                    high, landed = end, True
            if high >= until[n]:
                break
            if landed:
                for axis in range(3):
                    at = start[axis] + high * rate[axis]
                    line[axis] = np.floor(at) + 1 if rate[axis] > 0 else np.ceil(at) - 1
                clearance = oz + high * dz - _height(heights, spacing, ox + high * dx, oy + high * dy)
                landed = False
            low, nearest, high = high, 0, np.inf
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
            clearance = following
    return out
