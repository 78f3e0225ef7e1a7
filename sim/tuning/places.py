"""Places of synthetic cases: rooms, halls, squares and outdoor worlds, with free space, doors, seats and what hides people."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy import ndimage

from tracker.geometry import Array, Mask
from tracker.geometry.ground import Flat, Grid, Ground
from worlds.catalogue import build
from worlds.terrain.free_space import FreeSpace, largest_region

SPACING = 0.15
"""m: of the grid of free space in rooms, halls and squares."""
BODY_RADIUS = 0.2
"""m: a person's middle keeps this distance from walls and furniture."""
LEVEL = Flat()
OUTDOOR_WORLDS = ("campus", "forest", "hills", "quarry", "ruins")
SPOTS = 14
"""Places of a case to which people walk."""


@dataclass(frozen=True, eq=False)
class Surroundings:
    """A place where people walk.

    free: of people. doors (d, 2), spots (s, 2), seats (k, 2) m: where people come in and leave, meet, and sit. ground: the terrain.
    pillars (p, 5): furniture and columns, as in Setup. occluders: heights of what stands on the ground, None where pillars tell all.
    area (2, 2): lowest and highest x, y m.
    """

    free: FreeSpace
    doors: Array
    spots: Array
    seats: Array
    area: Array
    ground: Ground = LEVEL
    pillars: Array = field(default_factory=lambda: np.zeros((0, 5)))
    occluders: Grid | None = None


def floor(area: Array, furniture: Array, doors: int, rng: np.random.Generator, ground: Ground = LEVEL) -> Surroundings:
    """The ground in an area (2, 2): lowest and highest x, y m, with furniture (p, 5) on it. Doors are at its border."""
    low, high = np.asarray(area, dtype=np.float64)
    columns, rows = (int(np.ceil(side / SPACING)) + 3 for side in (high - low).tolist())
    origin = low - SPACING
    x, y = origin[0] + SPACING * np.arange(columns), origin[1] + SPACING * np.arange(rows)
    across, along = (np.abs(v - (a + b) / 2) <= (b - a) / 2 - BODY_RADIUS for v, a, b in zip((x, y), low, high, strict=True))
    inside = across[None] & along[:, None]
    for one_x, one_y, radius, bottom, _ in furniture:
        if bottom < 1.8:
            inside &= (x[None] - one_x) ** 2 + (y[:, None] - one_y) ** 2 > (radius + BODY_RADIUS) ** 2
    free = FreeSpace(largest_region(inside), origin, SPACING)
    seats = _seats(free, furniture, rng)
    return Surroundings(free, _border(free, doors, rng), _spots(free, rng), seats, np.array([low, high]), ground, furniture)


def furniture(size: tuple[float, float], density: float, rng: np.random.Generator) -> Array:
    """Tables, shelves and columns as upright cylinders (p, 5): `density` of them a square metre."""
    count = int(rng.poisson(density * size[0] * size[1]))
    rows = []
    for _ in range(count):
        kind = rng.random()
        radius, top = (rng.uniform(0.3, 0.7), rng.uniform(0.65, 0.8)) if kind < 0.6 else (rng.uniform(0.25, 0.45), rng.uniform(1.1, 2.1))
        if kind > 0.9:
            radius, top = rng.uniform(0.15, 0.35), 4.0
        rows.append((*rng.uniform(0.0, size), radius, 0.0, top))
    return np.asarray(np.array(rows, dtype=np.float64).reshape(-1, 5).round(3), dtype=np.float64)


def outdoor(name: str, difficulty: float, rng: np.random.Generator) -> tuple[Surroundings, FreeSpace]:
    """An outdoor world, and the free space of rovers in it."""
    world = build(name, rng, difficulty)
    tops, spots = world.tops(), _spots(world.feet, rng)
    walked = world.terrain.on_grid
    ground = Grid(np.round(walked.heights, 3), walked.origin, walked.spacing)
    doors = world.spawn.mean(axis=1)
    points = world.feet.points(world.feet.free)
    area = np.array([points.min(axis=0), points.max(axis=0)]).round(2)
    occluders = Grid(np.round(tops.heights, 3), tops.origin, tops.spacing)
    return Surroundings(world.feet, doors, spots, np.zeros((0, 2)), area, ground, occluders=occluders), world.wheels


def _spots(free: FreeSpace, rng: np.random.Generator) -> Array:
    """Places (s, 2) m spread over free space: each is the farthest of some random ones from those before."""
    points = free.points(free.clearance > min(0.2, 0.5 * float(free.clearance.max())))
    return _spread(points, min(SPOTS, len(points)), rng)


def _border(free: FreeSpace, count: int, rng: np.random.Generator) -> Array:
    edge = free.free & ~ndimage.binary_erosion(free.free)
    return _spread(free.points(edge), count, rng)


def _spread(points: Array, count: int, rng: np.random.Generator) -> Array:
    chosen = [points[int(rng.integers(len(points)))]]
    while len(chosen) < count:
        some = points[rng.integers(len(points), size=4)]
        apart = np.linalg.norm(some[:, None] - np.array(chosen), axis=2).min(axis=1)
        chosen.append(some[int(np.argmax(apart))])
    return np.asarray(chosen, dtype=np.float64)


def _seats(free: FreeSpace, pillars: Array, rng: np.random.Generator) -> Array:
    """Up to three places (k, 2) m around each table."""
    out = []
    for x, y, radius, _, top in pillars:
        if 0.6 < top < 0.85:
            angles = rng.uniform(-np.pi, np.pi) + np.arange(3) * 2 * np.pi / 3
            out += [(x + (radius + 0.3) * np.cos(a), y + (radius + 0.3) * np.sin(a)) for a in angles]
    places = np.array(out).reshape(-1, 2)
    return places[free.clearance_at(places) > 0] if len(places) else places


def reached(ground: Ground, eye: Array, points: Array) -> Mask:
    """Which of points (n, 3) m nothing of a height map hides from `eye` (3,) m."""
    away = points - eye
    length = np.linalg.norm(away, axis=1)
    origins = np.broadcast_to(eye, points.shape)
    met, hit = ground.intersect(origins, away / length[:, None], float(length.max(initial=1.0)) + 1.0)
    return np.asarray(~hit | (np.linalg.norm(met - eye, axis=1) > length - 0.3))
