"""The ground plan of the world tunnel: passages, halls and the objects in them."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from worlds.terrain.heightfield import Array

LENGTH = 27.0
MARGIN = 2.2
"""m of rock around everything."""

Way = tuple[Array, Array, float]


@dataclass(frozen=True, eq=False)
class TunnelPlan:
    """The ground plan, in m.

    * ways: start (2,), end (2,) and half width of straight passages. halls: middle and radius.
    * bridges: place and yaw rad. ledges: place, yaw rad, and whether the ledge is high.
    * shafts, pillars: place and radius. lamps, rubble: places.
    """

    ways: list[Way]
    halls: list[tuple[Array, float]]
    bridges: list[tuple[Array, float]]
    ledges: list[tuple[Array, float, bool]]
    shafts: list[tuple[Array, float]]
    pillars: list[tuple[Array, float]]
    lamps: list[Array]
    rubble: list[Array]

    @property
    def extent(self) -> Array:
        """[[xmin, ymin], [xmax, ymax]] of it all, on whole metres."""
        low = [*(np.minimum(a, b) - w for a, b, w in self.ways), *(m - r for m, r in self.halls)]
        high = [*(np.maximum(a, b) + w for a, b, w in self.ways), *(m + r for m, r in self.halls)]
        return np.array([np.floor(np.min(low, axis=0) - MARGIN), np.ceil(np.max(high, axis=0) + MARGIN)])

    def room(self, points: Array) -> Array:
        """Points (..., 2) → (...) m to the nearest wall, negative in the rock."""
        room = np.full(points.shape[:-1], -np.inf)
        for a, b, half in self.ways:
            along = np.clip((points - a) @ (b - a) / float((b - a) @ (b - a)), 0, 1)
            room = np.maximum(room, half - np.linalg.norm(points - a - along[..., None] * (b - a), axis=-1))
        for middle, radius in self.halls:
            room = np.maximum(room, radius - np.linalg.norm(points - middle, axis=-1))
        return room


def draw(rng: np.random.Generator, difficulty: float) -> TunnelPlan:
    """A winding passage from west to east through three halls, a second one from the first hall to the last, and a dead end."""
    half = 1.75 - 0.2 * difficulty
    west = np.array([-LENGTH / 2, rng.uniform(-2, 2)])
    x = np.array([-7.5, 0.5, 8.5]) + rng.uniform(-0.8, 0.8, 3)
    y = np.array([rng.uniform(-1.5, 0.5), rng.uniform(2.5, 4.5), rng.uniform(-1.5, 0.5)])
    halls = [(np.array([a, b]), rng.uniform(2.9, 3.9)) for a, b in zip(x, y, strict=True)]
    east = np.array([LENGTH / 2, rng.uniform(-2, 2)])
    around = [np.array([x[0] + rng.uniform(1.5, 2.5), -6.0]), np.array([rng.uniform(0, 2), rng.uniform(-7.5, -6.0)]), np.array([x[2] - 2, -5.5])]
    blind = np.array([x[1] + rng.uniform(-2.0, 2.0), y[1] + 6.5])
    lines = [
        [west, halls[0][0]], _bent(rng, halls[0][0], halls[1][0]), _bent(rng, halls[1][0], halls[2][0]), [halls[2][0], east],
        [halls[0][0], *around, halls[2][0]], [halls[1][0], blind],
    ]  # fmt: skip
    ways = [(a, b, half + rng.uniform(-0.05, 0.3)) for line in lines for a, b in pairwise(line)]
    flip = rng.choice([-1.0, 1.0], 2)
    ways, halls = [(a * flip, b * flip, w) for a, b, w in ways], [(m * flip, r) for m, r in halls]
    bare = TunnelPlan(ways, halls, [], [], [], [], [], [])
    lower, stem = ways[6], ways[0]
    bridges = [_bridge(*lower[:2], rng.uniform(0.35, 0.65))] + [_bridge(*stem[:2], 0.25)] * (difficulty > 0.7)
    shafts = [(halls[k][0] + rng.uniform(-0.5, 0.5, 2), rng.uniform(0.9, 1.3)) for k in (0, 2)]
    pillars = [(m + _polar(rng, 0.45 * r), rng.uniform(0.38, 0.55)) for m, r in halls for _ in range(1)]
    lamps = [halls[1][0], (ways[0][0] + ways[0][1]) / 2, (lower[0] + lower[1]) / 2, ways[-1][1], (ways[5][0] * 0.4 + ways[5][1] * 0.6)]
    spots = [a + t * (b - a) for a, b, _ in ways for t in (0.3, 0.75)]
    heaps = [spots[k] + rng.uniform(-1.2, 1.2, 2) for k in rng.permutation(len(spots))[: 4 + round(4 * difficulty)]]
    keep = np.array([place for place, _ in bridges])
    heaps = [h for h in heaps if np.hypot(*(keep - h).T).min() > 3.2]
    return TunnelPlan(ways, halls, bridges, _ledges(rng, bare, keep), shafts, pillars, [np.asarray(p) for p in lamps], heaps)


def _bent(rng: np.random.Generator, a: Array, b: Array) -> list[Array]:
    """From a to b by way of a place beside the middle."""
    along = (b - a) / np.hypot(*(b - a))
    return [a, (a + b) / 2 + np.array([-along[1], along[0]]) * rng.choice([-1, 1]) * rng.uniform(0.6, 1.4), b]


def _polar(rng: np.random.Generator, radius: float) -> Array:
    angle = rng.uniform(-np.pi, np.pi)
    return radius * np.array([np.cos(angle), np.sin(angle)])


def _bridge(a: Array, b: Array, share: float) -> tuple[Array, float]:
    return a + share * (b - a), float(np.arctan2(*(b - a)[::-1]))


def _ledges(rng: np.random.Generator, plan: TunnelPlan, keep: NDArray[np.float64]) -> list[tuple[Array, float, bool]]:
    """Along the walls of passages and halls, in turn over the way and low beside it."""
    found: list[tuple[Array, float, bool]] = []
    for a, b, half in plan.ways:
        along = (b - a) / np.hypot(*(b - a))
        for share in (0.3, 0.55, 0.8):
            side = rng.choice([-1.0, 1.0])
            out = side * np.array([-along[1], along[0]])
            place = a + (share + rng.uniform(-0.08, 0.08)) * (b - a) + out * (half + 0.05)
            # Only at a real wall, not where a passage opens into a hall; and not beside a bridge.
            if abs(float(plan.room(place[None])[0])) < 0.3 and np.hypot(*(keep - place).T).min() > 2.6:
                found.append((place, float(np.arctan2(-out[1], -out[0])), len(found) % 3 != 2))
    return found
