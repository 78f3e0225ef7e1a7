"""A small indoor laboratory with an uneven floor: a platform with ramps and stairs, a ledge, a rough patch, furniture, three entrances.

After the test site of the paper: some 14 x 11 m, four small robots and about ten people.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from worlds.engine import mujoco
from worlds.props import furniture
from worlds.props.furniture import Furnishing, Maker
from worlds.props.rooms import add_beam, add_frame, add_partition, add_walls
from worlds.terrain.free_space import walkers_spaces
from worlds.terrain.heightfield import Array, Heightfield
from worlds.terrain.polygons import rectangle, turned
from worlds.terrain.relief import plateau, ramp, rubble, swell
from worlds.textures.floors import floor, hazards, lane, matting, planks
from worlds.textures.furniture_atlas import atlas
from worlds.textures.materials import Canvas, add_material, add_open_air, tint
from worlds.world import World

WALL_HEIGHT, WALL_THICKNESS = 2.8, 0.2
ALCOVE_WIDTH, ALCOVE_DEPTH = 2.1, 1.5
RAMP_WIDTH, TREAD = 1.7, 0.42


@dataclass(frozen=True, eq=False)
class PilsunPlan:
    """The ground plan, in m; polygons (k, 2) are anticlockwise.

    * outline: of the inside. doors: indices of its edges at the far ends of the alcoves.
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
    """Entrances west, south and east; platform north-east, ledge south-west, partition north; then a random reflection in x and y."""
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
    # Spawn areas keep people's shoulders off the door frame and the walls.
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


NAME = "pilsun"
SPACING = 0.125
# Least shares of the floor that must be free for feet and for wheels.
FREE_FOR_FEET, FREE_FOR_WHEELS = 0.6, 0.3


def build(rng: np.random.Generator, difficulty: float = 0.5) -> World:
    """A laboratory; seeds differ. Raises ValueError if people or rovers have too little free space."""
    plan = draw(rng, difficulty)
    ground = _ground(rng, plan, difficulty)
    spec = mujoco.MjSpec()
    spec.modelname = NAME
    add_material(spec, "furniture", atlas(rng))
    add_material(spec, "ground", _floor(rng, plan, ground), 0.15)
    add_open_air(spec, rng, ground, ((0.60, 0.71, 0.84), (0.86, 0.89, 0.92)), 0.55)
    furnishing = _rooms(spec, rng, plan, ground)
    _furnish(spec, rng, plan, furnishing, difficulty)
    floor_area = float((~furnishing.walls).sum()) * SPACING**2
    feet, wheels = walkers_spaces(NAME, ground, furnishing.blocked, (FREE_FOR_FEET * floor_area, FREE_FOR_WHEELS * floor_area))
    return World(NAME, spec, ground, feet, wheels, plan.spawn)


def _ground(rng: np.random.Generator, plan: PilsunPlan, difficulty: float) -> Heightfield:
    low, high = plan.outline.min(axis=0) - 0.25, plan.outline.max(axis=0) + 0.25
    ground = Heightfield.flat([np.floor(low * 4) / 4, np.ceil(high * 4) / 4], SPACING)
    nodes = ground.nodes
    built = [
        plateau(nodes, plan.platform, plan.height),
        plateau(nodes, plan.stair, plan.height / 2),
        plateau(nodes, plan.ledge, 0.12 + 0.03 * difficulty),
        *(ramp(nodes, foot, top, RAMP_WIDTH, plan.height) for foot, top in plan.ramps),
        rubble(rng, nodes, plan.rough, 1.3, 0.02 + 0.04 * difficulty),
    ]
    uneven = swell(rng, nodes, 3.5, 0.02 + 0.06 * difficulty) + swell(rng, nodes, 1.4, 0.01 + 0.075 * np.sqrt(difficulty))
    return ground.with_heights(np.maximum.reduce(built) + uneven)


def _floor(rng: np.random.Generator, plan: PilsunPlan, ground: Heightfield) -> Canvas:
    canvas = floor(rng, ground)
    matting(canvas, rng, ground, plan.ledge, tint(rng, (104, 116, 122), 14))
    for polygon in (plan.platform, plan.stair, *plan.ramp_areas):
        planks(canvas, rng, ground, polygon)
    for opening in plan.openings:
        inwards = plan.middle - opening.mean(axis=0)
        bay = opening + np.sign(inwards) * (np.ptp(opening, axis=0) == 0) * 1.2
        lane(canvas, rng, ground, [opening[0], bay[0], bay[1], opening[1]], (206, 168, 52))
    for _ in range(4):
        corners = rectangle(rng.uniform((-4, -3), (4, 3)), rng.uniform((1.0, 1.0), (2.5, 1.8)))
        lane(canvas, rng, ground, [*corners, corners[0]], tint(rng, ((210, 206, 198), (60, 96, 140), (168, 66, 54))[int(rng.integers(3))]))
    hazards(canvas, ground)
    return canvas


def _rooms(spec: mujoco.MjSpec, rng: np.random.Generator, plan: PilsunPlan, ground: Heightfield) -> Furnishing:
    """Walls, frames and beams, and areas that must stay clear of furniture."""
    furnishing = Furnishing(ground, plan.outline)
    add_walls(spec, rng, plan.outline, plan.doors, (WALL_THICKNESS, WALL_HEIGHT))
    furnishing.take(add_partition(spec, rng, "partition", plan.partition, (0.16, 2.3)))
    for k, opening in enumerate(plan.openings):
        for post in add_frame(spec, rng, f"frame{k}", opening, WALL_HEIGHT):
            furnishing.take(post)
        furnishing.keep_clear(rectangle(opening.mean(axis=0), (0.2, 0.2)), 1.6)
    for area in (plan.stair, *plan.ramp_areas):
        furnishing.keep_clear(area, 0.9)
    low, high = plan.outline.min(axis=0), plan.outline.max(axis=0)
    for k, x in enumerate(np.linspace(-4.5, 4.5, 3) + rng.uniform(-0.8, 0.8, 3)):
        add_beam(spec, rng, f"beam{k}", [(x, low[1] + 1.5), (x, high[1] + 0.1)], WALL_HEIGHT)
    return furnishing


def _furnish(spec: mujoco.MjSpec, rng: np.random.Generator, plan: PilsunPlan, furnishing: Furnishing, difficulty: float) -> None:
    """Pillars first, then pieces along walls, then free-standing pieces; pieces without a place are left out. Chairs stand before tables."""
    edges = np.stack([plan.outline, np.roll(plan.outline, -1, axis=0)], axis=1)
    long = edges[np.hypot(*(edges[:, 1] - edges[:, 0]).T) > 2.2]
    standing: list[Maker] = [lambda r: furniture.pillar(r, WALL_HEIGHT)] * 2
    along: list[Maker] = [*[furniture.shelf, furniture.cabinet] * (3 + round(2 * difficulty)), furniture.table, furniture.table]
    about: list[Maker] = [furniture.table, furniture.table, *[furniture.crates, furniture.barrel] * (1 + round(2 * difficulty))]
    for number, (piece, (position, yaw)) in enumerate(furnishing.places(rng, ((standing, False), (along, True), (about, False)), long)):
        furnishing.put(spec, f"{piece.kind}{number}", piece, (position, yaw))
        width, depth = piece.size
        for side in range(int(rng.integers(1, 3)) if piece.kind == "table" else 0):
            seat = furniture.chair(rng)
            where = position + turned([(side - 0.5) * 0.5 * width + rng.uniform(-0.1, 0.1), -depth / 2 - rng.uniform(0.05, 0.3)], yaw)
            furnishing.put(spec, f"chair{number}-{side}", seat, (where, yaw + rng.uniform(-0.5, 0.5)))
