"""The ground plan of the laboratory pilsun."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from worlds.terrain.heightfield import Array
from worlds.terrain.polygons import rectangle

WALL_HEIGHT, WALL_THICKNESS = 2.8, 0.2
ALCOVE_WIDTH, ALCOVE_DEPTH = 2.1, 1.5
RAMP_WIDTH, TREAD = 1.7, 0.42


@dataclass(frozen=True, eq=False)
class PilsunPlan:
    """The ground plan, in m; polygons (k, 2) are anticlockwise.

    * outline: of the inside. doors: its edges at the far ends of the alcoves.
    * openings (3, 2, 2): where the alcoves begin. spawn (3, 2, 2): areas in them.
    * partition (2, 2): the ends of a wall within the room.
    * platform: a polygon, `height` m high. stair; ramps (2, 2, 2): foot and top of each.
    * ledge: a polygon. rough (2,): the middle of a patch of broken floor.
    """

    outline: Array
    doors: tuple[int, ...]
    openings: Array
    spawn: Array
    partition: Array
    platform: Array
    stair: Array
    ramps: Array
    height: float
    ledge: Array
    rough: Array

    @property
    def middle(self) -> Array:
        """(2,) the middle of the outline's bounds."""
        return 0.5 * (self.outline.min(axis=0) + self.outline.max(axis=0))

    @property
    def ramp_areas(self) -> list[Array]:
        """The ramps as polygons (4, 2) m."""
        areas = []
        for foot, top in self.ramps:
            along = top - foot
            areas.append(rectangle((foot + top) / 2, (np.hypot(*along), RAMP_WIDTH), float(np.arctan2(along[1], along[0]))))
        return areas

    def mirrored(self, flip: ArrayLike) -> PilsunPlan:
        """The plan with x and y multiplied by flip (2,), each 1 or −1."""
        f = np.asarray(flip, dtype=np.float64)
        turn = slice(None, None, -1 if f[0] * f[1] < 0 else 1)
        k = len(self.outline)
        doors = self.doors if f[0] * f[1] > 0 else tuple((k - 2 - d) % k for d in self.doors)
        polygons = [(p * f)[turn] for p in (self.outline, self.platform, self.stair, self.ledge)]
        outline, platform, stair, ledge = polygons
        spawn = np.sort(self.spawn * f, axis=1)
        return PilsunPlan(
            outline, doors, self.openings * f, spawn, self.partition * f, platform, stair, self.ramps * f, self.height, ledge, self.rough * f
        )  # fmt: skip


def draw(rng: np.random.Generator, difficulty: float) -> PilsunPlan:
    """Ways in west, south and east; platform north-east, ledge south-west, partition north; then, maybe, mirrored."""
    west, south, east = rng.uniform(-7.2, -6.8), rng.uniform(-5.7, -5.3), rng.uniform(6.8, 7.2)
    north_west, north_east, cut = rng.uniform(5.2, 5.7), rng.uniform(5.2, 5.7), rng.uniform(0.8, 1.6)
    a, b, c = rng.uniform(-0.8, 1.8), rng.uniform(-3.9, -3.0), rng.uniform(-0.6, 1.4)
    w, d = ALCOVE_WIDTH, ALCOVE_DEPTH
    outline = [
        (west, south), (a, south), (a, south - d), (a + w, south - d), (a + w, south), (east, south),
        (east, b), (east + d, b), (east + d, b + w), (east, b + w), (east, north_east),
        (west + cut, north_west), (west, north_west - cut),
        (west, c + w), (west - d, c + w), (west - d, c), (west, c),
    ]  # fmt: skip
    openings = [[(a, south), (a + w, south)], [(east, b), (east, b + w)], [(west, c), (west, c + w)]]
    # People enter with their shoulders off the door frame and the walls.
    i, j = 0.56, 0.45
    spawn = [
        [(a + i, south - d + j), (a + w - i, south)],
        [(east, b + i), (east + d - j, b + w - i)],
        [(west - d + j, c + i), (west, c + w - i)],
    ]
    wall = west + rng.uniform(4.2, 5.2)
    partition = [(wall, max(north_east, north_west)), (wall + rng.uniform(-0.3, 0.3), north_west - rng.uniform(1.8, 2.4))]
    height = 0.30 + 0.10 * difficulty
    plan = PilsunPlan(
        np.array(outline), (2, 7, 14), np.array(openings), np.array(spawn), np.array(partition),
        *_platform(rng, np.array([east, north_east]), height), height, _ledge(rng, west, south), rng.uniform(-1.5, 1.5, 2),
    )  # fmt: skip
    return plan.mirrored(rng.choice([-1.0, 1.0], 2))


def _platform(rng: np.random.Generator, corner: Array, height: float) -> tuple[Array, Array, Array]:
    """Platform, stair and ramps into a corner (2,) m of the room: one ramp from the west, stair and the other ramp from the south."""
    east, north = corner
    west, south = rng.uniform(2.6, 3.2), rng.uniform(2.4, 2.8)
    run, overlap, half = height / np.tan(np.deg2rad(rng.uniform(9.5, 12.5))), 0.1, RAMP_WIDTH / 2
    y, x = north - half - rng.uniform(0.4, 0.6), east - half - rng.uniform(0.1, 0.3)
    ramps = [[(west - run, y), (west + overlap, y)], [(x, south - run), (x, south + overlap)]]
    platform = [(west, south), (east + 0.4, south), (east + 0.4, north + 0.8), (west, north + 0.8)]
    left, right = west + 0.1, x - half - 0.2
    stair = [(left, south - TREAD), (right, south - TREAD), (right, south + 0.05), (left, south + 0.05)]
    return np.array(platform), np.array(stair), np.array(ramps)


def _ledge(rng: np.random.Generator, west: float, south: float) -> Array:
    """A raised corner of the floor with an edge that is not straight."""
    reach = rng.uniform(2.6, 3.3)
    return np.array(
        [
            (west - 0.4, south - 0.4),
            (west + reach, south - 0.4),
            (west + reach, south + 0.55 * reach),
            (west + 0.6 * reach, south + 0.9 * reach),
            (west - 0.4, south + 0.9 * reach),
        ]
    )
