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
        """March by half a cell of plane distance until below the ground, then halve the step 20 times."""
        o, d = np.asarray(origins, dtype=np.float64), np.asarray(directions, dtype=np.float64)
        # The first place where a ray can touch: the highest point of the grid.
        top = float(self.heights.max()) + 1e-6
        start = np.where((o[:, 2] > top) & (d[:, 2] < 0), (o[:, 2] - top) / np.maximum(-d[:, 2], 1e-12), 0.0)
        step = 0.5 * self.spacing / np.maximum(np.hypot(d[:, 0], d[:, 1]), 0.05)
        low, high = start.copy(), start.copy()
        hit = np.zeros(len(o), dtype=bool)
        active = start < limit
        while active.any():
            k = np.flatnonzero(active)
            high[k] = np.minimum(low[k] + step[k], limit)
            p = o[k] + high[k, None] * d[k]
            below = p[:, 2] <= self.height_at(p)
            hit[k[below]] = True
            active[k[below]] = False
            over = k[~below]
            low[over] = high[over]
            gone = (low[over] >= limit) | ((d[over, 2] >= 0) & (o[over, 2] + low[over] * d[over, 2] > top))
            active[over[gone]] = False
        for _ in range(20):
            middle = 0.5 * (low + high)
            p = o + middle[:, None] * d
            below = p[:, 2] <= self.height_at(p)
            high, low = np.where(below, middle, high), np.where(below, low, middle)
        return o + np.where(hit, high, 0.0)[:, None] * d, hit
