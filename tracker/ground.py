"""What is known of the terrain: heights under points, and where a line of sight meets it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tracker.geometry import Array, frozen


class Ground(Protocol):
    """Terrain as a height over the plane."""

    def height_at(self, points: ArrayLike) -> Array:
        """(n, 2 or more) x, y m → (n,) heights m; the nearest known height outside."""
        ...

    def intersect(self, origins: ArrayLike, directions: ArrayLike, limit: float) -> tuple[Array, NDArray[np.bool_]]:
        """Rays from (n, 3) m along unit (n, 3) → first points on the ground (n, 3) m and whether there is one within `limit` m."""
        ...


@dataclass(frozen=True)
class Flat:
    """The plane z = level."""

    level: float = 0.0

    def height_at(self, points: ArrayLike) -> Array:
        return np.full(len(np.asarray(points)), self.level)

    def intersect(self, origins: ArrayLike, directions: ArrayLike, limit: float) -> tuple[Array, NDArray[np.bool_]]:
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

    def intersect(self, origins: ArrayLike, directions: ArrayLike, limit: float) -> tuple[Array, NDArray[np.bool_]]:
        """From one line of the mesh to the next: between them a ray's height over the ground is linear, so the first crossing is exact.

        A ray that begins on or under the ground meets it where it begins, unless it is above at the next line: from the feet one sees
        the sky. Raises ValueError for a limit that is not finite.
        """
        if not np.isfinite(limit):
            raise ValueError(f"limit is {limit} m, needs to be finite")
        o, d = np.asarray(origins, dtype=np.float64), np.asarray(directions, dtype=np.float64)
        # The first place where a ray can touch: the highest point of the grid.
        top = float(self.heights.max()) + 1e-6
        start = np.where((o[:, 2] > top) & (d[:, 2] < 0), (o[:, 2] - top) / np.maximum(-d[:, 2], 1e-12), 0.0)
        lines = _MeshLines.of((o[:, :2] - self.origin) / self.spacing, d[:, :2] / self.spacing, start)
        low, over = start.copy(), self._over(o + start[:, None] * d)
        hit = np.zeros(len(o), dtype=bool)
        active = np.flatnonzero(start < limit)
        while len(active):
            high = np.minimum(lines.advance(active), limit)
            p = o[active] + high[:, None] * d[active]
            now = self._over(p)
            below = now <= 0
            # Rays that cross: the line between the two heights falls to zero here.
            k = active[below]
            before = np.maximum(over[k], 0.0)
            low[k] += before / np.maximum(before - now[below], 1e-300) * (high[below] - low[k])
            hit[k] = True
            low[active[~below]], over[active[~below]] = high[~below], now[~below]
            active = active[~below & (high < limit) & ((d[active, 2] < 0) | (p[:, 2] <= top))]
        return o + np.where(hit, low, 0.0)[:, None] * d, hit

    def _over(self, points: Array) -> Array:
        """How high points (n, 3) m stand over the ground, (n,) m."""
        return np.asarray(points[:, 2] - self.height_at(points))


class _MeshLines:
    """Where rays over a unit grid cross its lines: x whole, y whole, and x − y whole, the diagonals of the cells.

    coordinate (n, 3) of each ray in those three, rate (n, 3) its change along the ray, line (n, 3) the next whole number to be crossed.
    """

    def __init__(self, coordinate: Array, rate: Array, line: Array) -> None:
        self.coordinate, self.rate, self.line = coordinate, rate, line

    @staticmethod
    def of(origins: Array, directions: Array, start: Array) -> _MeshLines:
        coordinate, rate = (np.column_stack([v, v[:, 0] - v[:, 1]]) for v in (origins, directions))
        here = coordinate + start[:, None] * rate
        return _MeshLines(coordinate, rate, np.where(rate > 0, np.floor(here) + 1, np.ceil(here) - 1))

    def advance(self, rays: NDArray[np.int64]) -> Array:
        """Step `rays` (k,) to their next line; returns how far along the ray it lies (k,), inf where there is none."""
        rate = self.rate[rays]
        still = np.abs(rate) < 1e-12
        distance = np.where(still, np.inf, (self.line[rays] - self.coordinate[rays]) / np.where(still, 1.0, rate))
        nearest = distance.argmin(axis=1)
        self.line[rays, nearest] += np.sign(rate[np.arange(len(rays)), nearest])
        return np.asarray(distance[np.arange(len(rays)), nearest])
