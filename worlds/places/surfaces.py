"""The walkable level of a set of triangles: its heights on a grid, its obstacles, and the triangles that feet touch.

Vertical lines through the grid points intersect the triangles in layers. A layer is walkable where it faces up and has headroom.
Layers connected by a step or a slope form one level. Only geometry is used: neither names nor the connectivity of meshes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy import ndimage, sparse
from scipy.sparse import csgraph

from worlds.terrain.free_space import FEET, WHEELS, Limits
from worlds.terrain.heightfield import Array, Heightfield, Mask
from worlds.terrain.walk_surface import Decks, Terrain

Index = NDArray[np.int64]

HEADROOM = 2.05
"""m that people and masts of rovers need over the floor; doors are 2.0 to 2.1 m high."""
THIN = 0.02
"""m: layers nearer to each other count as one, such as a floor and the slab under it."""
LEAST_SHARE = 0.4
"""Share of the largest level: by default, people use the lowest level of at least this share. A roof is larger than the rooms below it."""
FLAT = 0.05
"""Least z of the unit normal of a triangle on which people can stand."""
APART = 0.015
"""m: grid points are blocked where the triangles that feet touch are farther than this from the level."""


@dataclass(frozen=True, eq=False)
class Level:
    """A walkable level. contact: heights with which wheels collide, obstacles raised. blocked: masks (rows, columns) for feet and for wheels.

    decks (k,): mask of the triangles on which people stand. others: number of levels that are left out.
    """

    terrain: Terrain
    contact: Heightfield
    blocked: tuple[Mask, Mask]
    decks: Mask
    others: int


def find_level(triangles: Array, grid: Heightfield, height: float | None, entrances: Array) -> Level:
    """The level of triangles (k, 3, 3) m on a grid: the one at `height` m, else that of the entrances (n, 2) m, else the lowest large one.

    Raises ValueError if there is no place to stand, or none at `height`.
    """
    layers = _Layers.of(triangles, grid)
    floor, others = layers.level(grid, height, entrances)
    known = np.isfinite(floor)
    limits = np.array([_climb(kind, grid.spacing) for kind in (FEET, WHEELS)])
    blocked, top, touching = _met(triangles, grid, floor, limits)
    nearest = tuple(ndimage.distance_transform_edt(~known, return_distances=False, return_indices=True))
    filled = floor[nearest]
    normal = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    up = normal[:, 2] > FLAT * np.maximum(np.linalg.norm(normal, axis=1), 1e-12)
    decks = up & touching
    # The ground lies below all decks, so that the triangles themselves are the terrain wherever there are any.
    below = grid.with_heights(ndimage.minimum_filter(filled, 3) - THIN)
    terrain = Terrain(below, Decks(triangles[decks]))
    elsewhere = ~known | (np.abs(terrain.on_grid.heights - filled) > APART)
    contact = np.where(known, np.fmax(top, filled), filled + 1.0)
    return Level(terrain, grid.with_heights(contact), (blocked[0] | elsewhere, blocked[1] | elsewhere), decks, others)


def _climb(limits: Limits, spacing: float) -> float:
    """m: the greatest rise from one grid point to the next that these limits allow."""
    return max(limits.step, spacing * float(np.tan(limits.slope))) + 1e-6


@dataclass(frozen=True, eq=False)
class _Layers:
    """Places to stand: flat grid index node (n,) and height z (n,) m, ordered by both."""

    node: Index
    z: Array

    @staticmethod
    def of(triangles: Array, grid: Heightfield) -> _Layers:
        size = (grid.heights.shape[0], grid.heights.shape[1])
        local = np.ascontiguousarray((triangles - [*grid.origin, 0.0]) / [grid.spacing, grid.spacing, 1.0])
        count = _crossings(local, size, np.zeros(0, np.int64), np.zeros(0), np.zeros(0))
        node, z, facing = np.zeros(count, np.int64), np.zeros(count), np.zeros(count)
        _crossings(local, size, node, z, facing)
        order = np.lexsort((z, node))
        node, z, facing = node[order], z[order], facing[order]
        # Equal heights, as at the edge that two triangles share, and thin layers count once, by the highest one that faces up.
        stands = np.zeros(count, dtype=bool)
        _standing(node, z, facing, stands)
        return _Layers(node[stands], z[stands])

    def level(self, grid: Heightfield, height: float | None, entrances: Array) -> tuple[Array, int]:
        """Heights (rows, columns) m of the chosen level, NaN elsewhere; and the number of other levels with 5 % of the largest one's nodes."""
        if not len(self.node):
            raise ValueError("nothing in it can be stood on: no surface looks up with 2.05 m of headroom (is up= right?)")
        label = self._joined(grid)
        columns = np.bincount(np.unique(np.stack([label, self.node]), axis=1)[0])
        middle = ndimage.mean(self.z, label, np.arange(len(columns)))
        large = np.flatnonzero(columns >= LEAST_SHARE * columns.max())
        if height is not None:
            near = np.abs(self.z - height) < 0.3
            if not near.any():
                raise ValueError(f"nothing at level {height:g} m can be stood on; there are floors at {_listed(middle[large])} m")
            chosen = int(np.argmax(np.bincount(label[near], minlength=len(columns))))
        elif len(entrances):
            at = np.rint((entrances - grid.origin) / grid.spacing).astype(np.int64)
            there = np.isin(self.node, at[:, 1] * grid.heights.shape[1] + at[:, 0])
            votes = np.bincount(label[there], minlength=len(columns))
            chosen = int(np.argmax(votes)) if there.any() else int(large[np.argmin(middle[large])])
        else:
            chosen = int(large[np.argmin(middle[large])])
        floor = np.full(grid.heights.size, np.nan)
        mine = label == chosen
        # Written from the highest to the lowest, so that the lowest layer of a grid point remains.
        floor[self.node[mine][::-1]] = self.z[mine][::-1]
        others = int((columns >= 0.05 * columns.max()).sum()) - 1
        return floor.reshape(grid.heights.shape), others

    def _joined(self, grid: Heightfield) -> Index:
        """Level number (n,) of every layer."""
        rows, columns = grid.heights.shape
        start = np.searchsorted(self.node, np.arange(rows * columns + 1))
        links = [_neighbours(self.node, self.z, start, step, (columns, _climb(FEET, grid.spacing))) for step in (1, columns)]
        a, b = np.concatenate(links, axis=1)
        n = len(self.node)
        graph = sparse.csr_matrix((np.ones(len(a), np.int8), (a, b)), shape=(n, n))
        return np.asarray(csgraph.connected_components(graph, directed=False)[1], dtype=np.int64)


def _listed(heights: Array) -> str:
    return ", ".join(f"{z:.1f}" for z in np.sort(heights)[:6])


@njit(cache=True)
def _crossings(triangles: Array, size: tuple[int, int], node: Index, z: Array, facing: Array) -> int:
    """Number of intersections of vertical lines at integer x, y with triangles; they are written unless node is empty. facing: sign of normal z."""
    rows, columns = size
    count = 0
    for t in range(len(triangles)):
        ax, ay, az = triangles[t, 0]
        ux, uy, uz = triangles[t, 1] - triangles[t, 0]
        vx, vy, vz = triangles[t, 2] - triangles[t, 0]
        area = ux * vy - uy * vx
        if abs(area) < 1e-12:
            continue
        low_x, high_x = min(ax, ax + ux, ax + vx), max(ax, ax + ux, ax + vx)
        low_y, high_y = min(ay, ay + uy, ay + vy), max(ay, ay + uy, ay + vy)
        for i in range(max(0, int(np.ceil(low_y - 1e-9))), min(rows - 1, int(np.floor(high_y + 1e-9))) + 1):
            for j in range(max(0, int(np.ceil(low_x - 1e-9))), min(columns - 1, int(np.floor(high_x + 1e-9))) + 1):
                x, y = j - ax, i - ay
                a, b = (x * vy - y * vx) / area, (ux * y - uy * x) / area
                if a < -1e-9 or b < -1e-9 or a + b > 1 + 1e-9:
                    continue
                if len(node):
                    node[count], z[count], facing[count] = i * columns + j, az + a * uz + b * vz, np.sign(area)
                count += 1
    return count


@njit(cache=True)
def _standing(node: Index, z: Array, facing: Array, stands: Mask) -> None:
    """Mark intersections that face up and have headroom; intersections are ordered by node and height.

    A point right below a surface that faces up is inside a solid.
    """
    for k in range(len(node)):
        if facing[k] <= 0:
            continue
        free = True
        for n in range(k + 1, len(node)):
            if node[n] != node[k] or z[n] > z[k] + HEADROOM:
                # A surface above the headroom decides only whether the point is inside a solid.
                free = node[n] != node[k] or facing[n] < 0
                break
            if z[n] > z[k] + THIN or facing[n] > 0:
                free = False
                break
        stands[k] = free


@njit(cache=True)
def _neighbours(node: Index, z: Array, start: Index, step: int, limits: tuple[int, float]) -> Index:
    """Pairs (2, m) of layers at neighbouring nodes that a step connects. limits: columns, and the greatest rise m."""
    columns, climb = limits
    pairs = []
    for k in range(len(node)):
        other = node[k] + step
        if other >= len(start) - 1 or (step == 1 and other % columns == 0):
            continue
        for n in range(start[other], start[other + 1]):
            if abs(z[n] - z[k]) <= climb:
                pairs.append((k, n))
    out = np.empty((2, len(pairs)), np.int64)
    for n in range(len(pairs)):
        out[0, n], out[1, n] = pairs[n]
    return out


def _met(triangles: Array, grid: Heightfield, floor: Array, limits: Array) -> tuple[Mask, Array, Mask]:
    """Obstacles on a floor (rows, columns) m. limits: (2,) m that feet and wheels can climb.

    Returns masks (2, rows, columns) of obstacles above each limit, and tops (rows, columns) m of obstacles of wheels, NaN for none.
    The third value is a mask (k,) of triangles that lie somewhere within the first limit of the floor.
    """
    blocked, top, touching = np.zeros((2, *floor.shape), dtype=bool), np.full(floor.shape, np.nan), np.zeros(len(triangles), dtype=bool)
    _stand_on(np.ascontiguousarray(triangles), np.array([*grid.origin, grid.spacing]), floor, limits, (blocked, top, touching))
    return blocked, top, touching


@njit(cache=True)
def _stand_on(triangles: Array, grid: Array, floor: Array, limits: Array, out: tuple[Mask, Array, Mask]) -> None:
    """Sample all triangles half a cell apart; mark triangles on the floor, and obstacles that reach into the headroom over it."""
    blocked, top, touching = out
    rows, columns = floor.shape
    for t in range(len(triangles)):
        a, u, v = triangles[t, 0], triangles[t, 1] - triangles[t, 0], triangles[t, 2] - triangles[t, 0]
        n = max(1, int(np.ceil(2 * np.sqrt(max((u**2).sum(), (v**2).sum(), ((u - v) ** 2).sum())) / grid[2])))
        for p in range(n + 1):
            for q in range(n + 1 - p):
                x, y = a[0] + (p * u[0] + q * v[0]) / n, a[1] + (p * u[1] + q * v[1]) / n
                i, j = int(np.rint((y - grid[1]) / grid[2])), int(np.rint((x - grid[0]) / grid[2]))
                if i < 0 or j < 0 or i >= rows or j >= columns or np.isnan(floor[i, j]):
                    continue
                z = a[2] + (p * u[2] + q * v[2]) / n
                over = z - floor[i, j]
                touching[t] |= abs(over) <= limits[0]
                if over >= HEADROOM:
                    continue
                for k in range(2):
                    if over > limits[k]:
                        blocked[k, i, j] = True
                if over > limits[1] and not top[i, j] > z:
                    top[i, j] = z
