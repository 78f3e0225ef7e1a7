"""The ground plan of the world ruins: walls, doorways, and how much of each wall is left."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from worlds.terrain.heightfield import Array
from worlds.terrain.polygons import rectangle, turned

THICKNESS = 0.5
SPRING, RING, PIER = 1.95, 0.34, 0.5
"""m: an arch begins to curve that high, its ring is that thick and stands on walls that long."""
COURT = 9.4
"""m from the middle to the outer walls."""


@dataclass(frozen=True, eq=False)
class Run:
    """What is left of a wall between two heights: from start (2,) m along yaw rad, (k,) m along it and the height of the top there, m."""

    start: Array
    yaw: float
    along: Array
    top: Array

    def corners(self) -> Array:
        """The strip (4, 2) m that it stands on."""
        middle = self.start + turned([(self.along[0] + self.along[-1]) / 2, 0.0], self.yaw)
        return rectangle(middle, (self.along[-1] - self.along[0], THICKNESS), self.yaw)


@dataclass(frozen=True, eq=False)
class RuinsPlan:
    """The ground plan, in m, rotated by `yaw` rad.

    runs: pieces of wall. arches: middle (2,), yaw rad and span of each. rooms (k, 4, 2): corners. court: the number of the room with columns.
    terrace: the number of the room with a raised floor.
    """

    runs: list[Run]
    arches: list[tuple[Array, float, float]]
    rooms: Array
    court: int
    terrace: int
    yaw: float


def draw(rng: np.random.Generator, difficulty: float) -> RuinsPlan:
    """Nine rooms in three rows. Each wall has a doorway or has fallen for good."""
    x, y = (np.array([-COURT, -3.2, 3.2, COURT]) + np.array([0, *rng.uniform(-0.7, 0.7, 2), 0]) for _ in range(2))
    yaw = rng.uniform(-0.16, 0.16)
    runs: list[Run] = []
    arches: list[tuple[Array, float, float]] = []
    for k in range(4):
        for j in range(3):
            for a, b in (((x[j], y[k]), (x[j + 1], y[k])), ((x[k], y[j]), (x[k], y[j + 1]))):
                outer = k in (0, 3)
                if not outer and rng.uniform() < 0.16:
                    continue
                _wall(rng, (turned(a, yaw), turned(b, yaw)), difficulty, (runs, arches))
    rooms = [turned([(x[j], y[i]), (x[j + 1], y[i]), (x[j + 1], y[i + 1]), (x[j], y[i + 1])], yaw) for i in range(3) for j in range(3)]
    court, terrace = rng.permutation([1, 3, 4, 5, 7])[:2].tolist()
    return RuinsPlan(runs, arches, np.array(rooms), court, terrace, yaw)


def _wall(rng: np.random.Generator, ends: tuple[Array, Array], difficulty: float, out: tuple[list[Run], list[tuple[Array, float, float]]]) -> None:
    """A wall with a doorway in it: under an arch, or as wide as what has fallen out of the wall."""
    a, b = ends
    length = float(np.hypot(*(b - a)))
    yaw = float(np.arctan2(*(b - a)[::-1]))
    span, arched = rng.uniform(1.5, 1.9), rng.uniform() < 0.45
    if not arched:
        span += rng.uniform(0, 1.4)
    middle = length * rng.uniform(0.38, 0.62)
    tall = rng.uniform(0.9, 1.7) + 1.5 * difficulty * rng.uniform(0.5, 1.0)
    low, high = middle - span / 2, middle + span / 2
    if arched:
        out[1].append((a + turned([middle, 0], yaw), yaw, span))
        for start, end in ((low - PIER, low), (high, high + PIER)):
            out[0].append(Run(a, yaw, np.array([start, end]), np.full(2, SPRING)))
        low, high = low - PIER, high + PIER
    for start, end, at_arch in ((-THICKNESS / 2, low, arched), (high, length + THICKNESS / 2, arched)):
        count = max(2, round((end - start) / 1.1) + 1)
        along = np.linspace(start, end, count)
        along[1:-1] += rng.uniform(-0.25, 0.25, count - 2)
        top = np.clip(tall + np.cumsum(rng.uniform(-0.7, 0.7, count)), 0.5, 2.2 + 1.2 * difficulty)
        if at_arch:
            top[-1 if start < 0 else 0] = rng.uniform(SPRING, SPRING + 0.6)
        out[0].append(Run(a, yaw, along, top))
