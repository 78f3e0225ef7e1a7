"""Free space of one kind of walker on a grid: clearance, weighted shortest paths, random places in it, and spawn areas."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import ndimage, sparse
from scipy.sparse import csgraph

from worlds.terrain.heightfield import Array, Heightfield, Mask

# (row, column) steps to half of the eight neighbours; the other half follows by symmetry.
_NEIGHBOURS = ((0, 1), (1, 0), (1, 1), (1, -1))


def links(free: Mask, cost: Array) -> sparse.csr_matrix:
    """Free grid points (rows, columns), each linked with its free neighbours by the mean cost of both; none across a blocked corner."""
    rows, columns = free.shape
    number = np.arange(rows * columns).reshape(rows, columns)
    starts, ends, costs = [], [], []
    for di, dj in _NEIGHBOURS:
        here = (slice(0, rows - di), slice(max(0, -dj), columns - max(0, dj)))
        there = (slice(di, rows), slice(max(0, dj), columns - max(0, -dj)))
        passable = free[here] & free[there]
        if di and dj:
            passable &= free[here[0], there[1]] & free[there[0], here[1]]
        starts.append(number[here][passable])
        ends.append(number[there][passable])
        costs.append(np.hypot(di, dj) * 0.5 * (cost[here] + cost[there])[passable])
    shape = (rows * columns, rows * columns)
    return sparse.csr_matrix((np.concatenate(costs), (np.concatenate(starts), np.concatenate(ends))), shape=shape)


def distance(graph: sparse.csr_matrix, cost: Array, start: int) -> Array:
    """Distance (rows, columns) of each grid point from the flat index `start`; inf without a path. cost (rows, columns): per cell.

    Dijkstra's algorithm on the links allows eight directions. Its result is relaxed to the eikonal equation |∇T| = cost, which allows all
    (Sethian 1996, "A fast marching level set method"; Godunov's upwind differences, here at all points at once until nothing changes).
    """
    field = csgraph.dijkstra(graph, directed=False, indices=start).reshape(cost.shape)
    T = np.pad(field, 1, constant_values=np.inf)
    i, j = np.nonzero(np.isfinite(field) & (field > 0))
    here = (i + 1) * T.shape[1] + j + 1
    flat, c = T.ravel(), cost[i, j]
    for _ in range(2 * sum(field.shape)):
        a = np.minimum(flat[here - 1], flat[here + 1])
        b = np.minimum(flat[here - T.shape[1]], flat[here + T.shape[1]])
        near, far = np.minimum(a, b), np.maximum(a, b)
        # If the farther neighbour is at least c above the nearer one, only the nearer one counts; both formulas agree at c.
        gap = np.minimum(far - near, c)
        new = np.minimum(flat[here], near + 0.5 * (gap + np.sqrt(2 * c**2 - gap**2)))
        change = float((flat[here] - new).max(initial=0.0))
        flat[here] = new
        if change < 1e-4:
            break
    return T[1:-1, 1:-1].copy()


# Paths keep off obstacles: a metre right beside an obstacle costs 1 + SHYNESS, a metre at least SHY_DISTANCE m from all costs 1.
SHYNESS = 2.0

SHY_DISTANCE = 0.5

# The length over which slopes are averaged, m: about a stride of a walker and the wheelbase of a rover.
STRIDE = 0.6


@dataclass(frozen=True)
class Limits:
    """Limits of a walker: the steepest slope rad, the highest step m, and half_width m of its body."""

    slope: float
    step: float
    half_width: float


FEET = Limits(float(np.deg2rad(40)), 0.25, 0.25)

WHEELS = Limits(float(np.deg2rad(20)), 0.05, 0.30)
"""FEET are the limits of a person; WHEELS are those of a small rover with wheels of 0.1 m radius."""


@dataclass(frozen=True, eq=False)
class FreeSpace:
    """Free places of a walker's centre: free (rows, columns), row 0 at the lowest y; origin (2,) m; spacing m.

    The walker's half width is already subtracted (free_space), so clearances are the margins beside its body. The border of free space
    runs midway between free and blocked grid points. Raises ValueError if nothing is free, if free places are not connected,
    or if outermost grid points are free: nobody may leave the grid.
    """

    free: Mask
    origin: Array
    spacing: float

    def __post_init__(self) -> None:
        free, origin = np.array(self.free, dtype=np.bool_), np.array(self.origin, dtype=np.float64)
        if free.ndim != 2 or origin.shape != (2,) or not self.spacing > 0:
            raise ValueError(f"free {free.shape}, origin {origin.shape}, spacing {self.spacing} m: need (rows, columns), (2,), above 0")
        regions = ndimage.label(free)[1]
        if regions != 1:
            raise ValueError(f"free space has {regions} regions, needs 1")
        if free[[0, -1]].any() or free[:, [0, -1]].any():
            raise ValueError("free space reaches the border of its grid, needs a blocked frame")
        free.flags.writeable = origin.flags.writeable = False
        object.__setattr__(self, "free", free)
        object.__setattr__(self, "origin", origin)

    @property
    def area(self) -> float:
        """Free area, m²."""
        return float(self.free.sum()) * self.spacing**2

    @cached_property
    def clearance(self) -> Array:
        """(rows, columns) m from each grid point to the border of free space, negative where blocked."""
        inside, outside = ndimage.distance_transform_edt(self.free), ndimage.distance_transform_edt(~self.free)
        return np.where(self.free, inside - 0.5, 0.5 - outside) * self.spacing

    def clearance_at(self, points: ArrayLike) -> Array:
        """(n, 2) m → (n,) m to the nearest blocked place; 0 or less where blocked, decreasing with the distance outside of the grid."""
        index, weight, beyond = self._corners(points)
        return (self.clearance.ravel()[index] * weight).sum(axis=1) - beyond

    def away_at(self, points: ArrayLike) -> Array:
        """(n, 2) m → (n, 2) unit direction of growing clearance; zero where there is none, as halfway between two walls."""
        index, weight, _ = self._corners(points)
        return _unit((self._clearance_gradient[index] * weight[..., None]).sum(axis=1))

    def free_at(self, points: ArrayLike) -> Mask:
        """(n, 2) m → (n,) whether the nearest grid point is free."""
        rows, columns = self.free.shape
        p = np.asarray(points, dtype=np.float64).reshape(-1, 2)
        j, i = np.rint((p - self.origin) / self.spacing).astype(np.int64).T
        inside = (i >= 0) & (j >= 0) & (i < rows) & (j < columns)
        return inside & self.free[np.clip(i, 0, rows - 1), np.clip(j, 0, columns - 1)]

    def distance_to(self, goal: ArrayLike) -> Array:
        """(2,) m → (rows, columns) m of the shortest path from each grid point to the goal; inf where there is none.

        Metres beside obstacles count more (SHYNESS), so that paths keep off walls. Raises ValueError if the goal is not free.
        """
        return distance(self._links, self._cost * self.spacing, self._node(goal, "goal"))

    def direction_at(self, field: Array, points: ArrayLike) -> Array:
        """Points (n, 2) m → (n, 2) unit direction of descent of a field (rows, columns) from distance_to; zero at its goal.

        Where a point has no free grid point around it, the direction is that of growing clearance, back to free space.
        """
        index, weight, _ = self._corners(points)
        columns = field.shape[1]
        flat = field.ravel()
        slope = np.zeros((*index.shape, 2))
        here = flat[index]
        for axis, step in ((0, 1), (1, columns)):
            before, after = flat[np.maximum(index - step, 0)], flat[np.minimum(index + step, flat.size - 1)]
            lower = np.minimum(before, after)
            fall = np.subtract(here, lower, out=np.zeros_like(here), where=np.isfinite(here) & (lower < here))
            slope[..., axis] = np.where(before < after, -fall, fall)
        weight = np.where(np.isfinite(here), weight, 0.0)
        direction = _unit((slope * weight[..., None]).sum(axis=1))
        lost = weight.sum(axis=1) <= 0
        if lost.any():
            direction[lost] = self.away_at(np.asarray(points, dtype=np.float64)[lost])
        return direction

    def route(self, start: ArrayLike, goal: ArrayLike) -> Array:
        """A path from start (2,) to goal (2,) m as a polyline (k, 2) within free space. Raises ValueError if start or goal is not free."""
        field = self.distance_to(goal)
        between = self._descent(field, self._node(start, "start"))[1:-1]
        ends = np.asarray(start, dtype=np.float64), np.asarray(goal, dtype=np.float64)
        return self._straightened(np.concatenate([[ends[0]], between, [ends[1]]]))

    def _descent(self, field: Array, node: int) -> Array:
        """Grid points (k, 2) m down a field from distance_to, from a flat index to the goal, each a neighbour of the one before."""
        columns = self.free.shape[1]
        nodes = [node]
        reach = np.array([[np.sqrt(2), 1, np.sqrt(2)], [1, 1, 1], [np.sqrt(2), 1, np.sqrt(2)]])
        while field.ravel()[node] > 0:
            i, j = divmod(node, columns)
            window = field[i - 1 : i + 2, j - 1 : j + 2].copy()
            # Diagonal steps need both grid points beside the diagonal to be free.
            for a, b in ((0, 0), (0, 2), (2, 0), (2, 2)):
                if not (np.isfinite(window[1, b]) and np.isfinite(window[a, 1])):
                    window[a, b] = np.inf
            di, dj = divmod(int(np.argmax((field[i, j] - window) / reach)), 3)
            node = (i + di - 1) * columns + j + dj - 1
            nodes.append(node)
        i, j = np.divmod(np.array(nodes), columns)
        return self.origin + self.spacing * np.stack([j, i], axis=1)

    def points(self, chosen: Mask) -> Array:
        """Grid points (n, 2) m where `chosen` (rows, columns) is true, row by row."""
        i, j = np.nonzero(chosen)
        return self.origin + self.spacing * np.stack([j, i], axis=1)

    def sample(self, rng: np.random.Generator, n: int, clearance: float, apart: float) -> Array:
        """n random places (n, 2) m with that clearance m and at least `apart` m from each other. Raises ValueError if n do not fit."""
        i, j = np.nonzero(self.clearance >= clearance - self.spacing)
        points = self.origin + self.spacing * (np.stack([j, i], axis=1) + rng.uniform(-0.5, 0.5, (len(i), 2)))
        points = rng.permutation(points[self.clearance_at(points) >= clearance])
        chosen: list[Array] = []
        while len(chosen) < n and len(points):
            chosen.append(points[0])
            points = points[np.hypot(*(points - points[0]).T) >= apart]
            if apart <= 0:
                points = points[1:]
        if len(chosen) < n:
            raise ValueError(f"{n} places with {clearance} m clearance and {apart} m apart are wanted, {len(chosen)} fit")
        return np.array(chosen).reshape(n, 2)

    @cached_property
    def _clearance_gradient(self) -> Array:
        north, east = np.gradient(self.clearance, self.spacing)
        return np.stack([east, north], axis=-1).reshape(-1, 2)

    @cached_property
    def _cost(self) -> Array:
        """Cost (rows, columns) of a metre at each grid point."""
        near = np.clip(1 - self.clearance / SHY_DISTANCE, 0.0, 1.0)
        return 1 + SHYNESS * near**2

    @cached_property
    def _links(self) -> sparse.csr_matrix:
        return links(self.free, self._cost * self.spacing)

    def _node(self, point: ArrayLike, name: str) -> int:
        p = np.asarray(point, dtype=np.float64).reshape(1, 2)
        if not self.free_at(p)[0]:
            raise ValueError(f"{name} ({p[0, 0]:.2f}, {p[0, 1]:.2f}) m is not free: there is no way")
        j, i = np.rint((p[0] - self.origin) / self.spacing).astype(np.int64)
        return int(i * self.free.shape[1] + j)

    def _corners(self, points: ArrayLike) -> tuple[NDArray[np.int64], Array, Array]:
        """Flat indices (n, 4) of the grid points around each point, their bilinear weights (n, 4), m outside of the grid (n,)."""
        rows, columns = self.free.shape
        p = (np.asarray(points, dtype=np.float64).reshape(-1, 2) - self.origin) / self.spacing
        q = np.clip(p, 0.0, [columns - 1, rows - 1])
        cell = np.minimum(q.astype(np.int64), [columns - 2, rows - 2])
        u, v = (q - cell).T
        first = cell[:, 1] * columns + cell[:, 0]
        index = first[:, None] + np.array([0, 1, columns, columns + 1])
        weight = np.stack([(1 - u) * (1 - v), u * (1 - v), (1 - u) * v, u * v], axis=1)
        return index, weight, np.hypot(*(p - q).T) * self.spacing

    def _straightened(self, points: Array) -> Array:
        """The path with fewer corners: segments stay free and come no nearer to obstacles than the part of the path that they replace.

        The comparison has a tolerance of half a cell, and clearances above SHY_DISTANCE count as equal.
        """
        clearance = np.minimum(self.clearance_at(points), SHY_DISTANCE) - 0.5 * self.spacing
        kept = [0]
        while kept[-1] < len(points) - 1:
            a, b = kept[-1], kept[-1] + 1
            for c in range(len(points) - 1, a + 1, -1):
                steps = max(2, int(np.hypot(*(points[c] - points[a])) / self.spacing * 4))
                line = points[a] + np.linspace(0, 1, steps)[:, None] * (points[c] - points[a])
                if self.free_at(line).all() and self.clearance_at(line).min() >= clearance[a : c + 1].min():
                    b = c
                    break
            kept.append(b)
        return points[kept]


def free_space(ground: Heightfield, obstacles: Mask, limits: Limits) -> FreeSpace:
    """The largest connected region where a walker with these limits may be, on the ground's own grid.

    obstacles (rows, columns): grid points that something stands on. Two kinds of grid points are blocked, too:

    * those with a rise to a neighbour above both limits.step and what limits.slope explains;
    * those where the ground, averaged over a STRIDE, is steeper than limits.slope.

    So a walker climbs a step and a slope, but no slope as steep as a step. Raises ValueError if nothing is free or the shapes differ.
    """
    if obstacles.shape != ground.heights.shape:
        raise ValueError(f"obstacles have shape {obstacles.shape}, need that of the ground, {ground.heights.shape}")
    blocked = obstacles | _too_steep(ground, limits)
    blocked[[0, -1]] = blocked[:, [0, -1]] = True
    distance = ndimage.distance_transform_edt(~blocked) * ground.spacing
    # The obstacle's own edge lies up to half a cell before its first blocked grid point.
    free = largest_region(distance > limits.half_width + 0.5 * ground.spacing)
    if not free.any():
        raise ValueError(f"no place has {limits.half_width} m clearance: nothing is free")
    return FreeSpace(free, ground.origin, ground.spacing)


def largest_region(free: Mask) -> Mask:
    """The largest connected part of a grid (rows, columns); all False if nothing is free."""
    labels, _ = ndimage.label(free)
    return np.asarray(labels == 1 + int(np.argmax(np.bincount(labels.ravel())[1:]))) if free.any() else np.zeros_like(free)


def walkers_spaces(name: str, ground: Heightfield, obstacles: Mask | tuple[Mask, Mask], least: tuple[float, float]) -> tuple[FreeSpace, FreeSpace]:
    """The free space of feet and that of wheels, as `free_space`. name: of the world. obstacles: one mask for both, or one for each.

    Raises ValueError if feet or wheels have less than their `least` m².
    """
    both = obstacles if isinstance(obstacles, tuple) else (obstacles, obstacles)
    feet, wheels = (free_space(ground, blocked, limits) for blocked, limits in zip(both, (FEET, WHEELS), strict=True))
    for walker, space, need in zip(("feet", "wheels"), (feet, wheels), least, strict=True):
        if space.area < need:
            raise ValueError(f"{space.area:.1f} m² of {name} are free for {walker}, need {need:.1f}")
    return feet, wheels


def _too_steep(ground: Heightfield, limits: Limits) -> Mask:
    spacing = ground.spacing
    steep = ground.rise > max(limits.step, spacing * np.tan(limits.slope)) + 1e-9
    smooth = ndimage.uniform_filter(ground.heights, max(1, round(STRIDE / spacing)), mode="nearest")
    slope = np.hypot(*np.gradient(smooth, spacing))
    return steep | (slope > np.tan(limits.slope))


def _unit(vectors: Array) -> Array:
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.where(length > 1e-9, vectors / np.maximum(length, 1e-9), 0.0)


def spawn_areas(feet: FreeSpace, rng: np.random.Generator, count: int, side: float = 1.2) -> Array:
    """`count` squares of that side m as (count, 2, 2) [[xmin, ymin], [xmax, ymax]] m, all of them free.

    The first is farthest from the mean of free places, each next one farthest from those before. Random factors from 0.85 to 1 vary it by seed.
    Raises ValueError if free space has no room for them.
    """
    places = feet.points(feet.clearance > side / np.sqrt(2) + feet.spacing)
    if len(places) < count:
        raise ValueError(f"{count} spawn areas of {side} m are wanted, free space has room for {len(places)}")
    distance = np.hypot(*(places - places.mean(axis=0)).T) * rng.uniform(0.85, 1.0, len(places))
    chosen = [places[int(np.argmax(distance))]]
    nearest = np.full(len(places), np.inf)
    while len(chosen) < count:
        nearest = np.minimum(nearest, np.hypot(*(places - chosen[-1]).T))
        chosen.append(places[int(np.argmax(nearest * rng.uniform(0.85, 1.0, len(places))))])
    middles = np.array(chosen)[:, None]
    return np.concatenate([middles - side / 2, middles + side / 2], axis=1)
