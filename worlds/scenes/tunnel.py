"""Passages and halls under the ground: a vault, ledges, a ditch with a slab as a bridge, and daylight through shafts.

The ground plan has passages, halls and the objects in them.
The floor and the foot of the walls are a height field. The vault, ledges, pillars and slabs are meshes.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from worlds.engine import mujoco
from worlds.props.meshes import Ceiling, hull, ledge, slab
from worlds.props.shapes import Shape
from worlds.terrain.free_space import spawn_areas, walkers_spaces
from worlds.terrain.heightfield import Array, Heightfield, Mask
from worlds.terrain.polygons import covered, rectangle, turned
from worlds.terrain.relief import fractal, rubble, swell
from worlds.terrain.walk_surface import Decks, Terrain
from worlds.textures.masonry import rock
from worlds.textures.materials import Canvas, add_material, add_sky, set_view
from worlds.world import World

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
    pillars = [(m + turned([0.45 * r, 0.0], rng.uniform(-np.pi, np.pi)), rng.uniform(0.38, 0.55)) for m, r in halls]
    lamps = [halls[1][0], (ways[0][0] + ways[0][1]) / 2, (lower[0] + lower[1]) / 2, ways[-1][1], (ways[5][0] * 0.4 + ways[5][1] * 0.6)]
    spots = [a + t * (b - a) for a, b, _ in ways for t in (0.3, 0.75)]
    heaps = [spots[k] + rng.uniform(-1.2, 1.2, 2) for k in rng.permutation(len(spots))[: 4 + round(4 * difficulty)]]
    keep = np.array([place for place, _ in bridges])
    heaps = [h for h in heaps if np.hypot(*(keep - h).T).min() > 3.2]
    return TunnelPlan(ways, halls, bridges, _ledge_places(rng, bare, keep), shafts, pillars, [np.asarray(p) for p in lamps], heaps)


def _bent(rng: np.random.Generator, a: Array, b: Array) -> list[Array]:
    """From a to b by way of a place beside the middle."""
    along = (b - a) / np.hypot(*(b - a))
    return [a, (a + b) / 2 + np.array([-along[1], along[0]]) * rng.choice([-1, 1]) * rng.uniform(0.6, 1.4), b]


def _bridge(a: Array, b: Array, share: float) -> tuple[Array, float]:
    return a + share * (b - a), float(np.arctan2(*(b - a)[::-1]))


def _ledge_places(rng: np.random.Generator, plan: TunnelPlan, keep: NDArray[np.float64]) -> list[tuple[Array, float, bool]]:
    """Ledges along the walls of passages: of three, two are above people's heads and one is low."""
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


NAME = "tunnel"
SPACING, VAULT_SPACING = 0.16, 0.5
WALL = 0.9
"""m: rise of the height field at the walls; above it is the vault."""
SOLE = 0.3
"""m: depth of pillars in the floor and in the vault."""
BRIDGE = (2.3, 2.2, 0.16)
DITCH = (1.1, 0.6)
"""m: length, width and thickness of a slab; width and depth of the ditch under it."""
FREE_FOR_FEET, FREE_FOR_WHEELS = 60.0, 30.0
"""m²: least free area of people and of rovers."""


@dataclass(frozen=True, eq=False)
class _Cave:
    """The tunnel under construction. room (rows, columns): m from the wall, negative in the rock. bed: the floor without its small unevenness."""

    spec: mujoco.MjSpec
    plan: TunnelPlan
    ground: Heightfield
    room: Array
    bed: Heightfield
    blocked: Mask

    def stand(self, shape: Shape, name: str, pos: Array, yaw: float = 0.0) -> mujoco.MjsGeom:
        return shape.add_to(self.spec, name, "rock", pos, yaw)


def build(rng: np.random.Generator, difficulty: float = 0.5) -> World:
    """A part of an underground system; seeds differ. Raises ValueError if people or rovers have too little free space."""
    plan = draw(rng, difficulty)
    cave = _dug(rng, plan, difficulty)
    spec = cave.spec
    spec.modelname = NAME
    add_material(spec, "rock", rock(rng, (142, 128, 112)), 0.05)
    add_material(spec, "ground", _floor(rng, cave), 0.05)
    cave.ground.add_to(spec, "ground", "ground").castshadow = False
    spec.add_material(name="glow", emission=1.0, rgba=[1.0, 0.95, 0.8, 1.0])
    add_sky(spec, (0.62, 0.74, 0.88), (0.86, 0.90, 0.93))
    set_view(spec, cave.ground.extent)
    _light(rng, cave)
    _vault(rng, cave)
    _pillars(rng, cave)
    bridges = _bridges(rng, cave)
    roofs = _ledges(rng, cave, difficulty)
    _stones(rng, cave, difficulty)
    terrain = Terrain(cave.ground, Decks.of(spec, bridges, roofs))
    feet, wheels = walkers_spaces(NAME, terrain.on_grid, cave.blocked, (FREE_FOR_FEET, FREE_FOR_WHEELS))
    return World(NAME, spec, cave.ground, feet, wheels, spawn_areas(feet, rng, 4), terrain.decks)


def _dug(rng: np.random.Generator, plan: TunnelPlan, difficulty: float) -> _Cave:
    """The floor and the foot of the walls, as a height field."""
    flat = Heightfield.flat(plan.extent, SPACING)
    nodes = flat.nodes
    room = plan.room(nodes) + swell(rng, nodes, 1.6, 0.14) + swell(rng, nodes, 0.6, 0.06)
    bed = swell(rng, nodes, 11.0, 0.1 + 0.5 * difficulty)
    fine = swell(rng, nodes, 1.8, 0.015 + 0.06 * difficulty) + swell(rng, nodes, 0.7, 0.008 + 0.028 * difficulty)
    for centre in plan.rubble:
        fine += rubble(rng, nodes, centre, 1.5, 0.05 + 0.17 * difficulty)
    # Debris slopes gather along the walls.
    fine += 0.35 * np.clip(0.45 - room, 0, 0.6) * (0.4 + difficulty)
    for place, yaw in plan.bridges:
        along, across = np.moveaxis(turned(nodes - place, -yaw), -1, 0)
        near = np.clip(2.4 - np.hypot(along, across * 0.6), 0, 1)
        level = float(flat.with_heights(bed).height_at(place[None])[0])
        bed, fine = bed + near * (level - bed), fine * (1 - near)
        edge = 0.12 * swell(rng, nodes, 0.9, 1.0)
        fine -= DITCH[1] * np.clip((DITCH[0] / 2 + edge * (np.abs(across) > 1.2) - np.abs(along)) / 0.16 + 0.5, 0, 1) * (np.abs(across) < 4.5)
    wall = np.clip(-room / 0.36, 0, 1) * WALL + 0.12 * swell(rng, nodes, 0.8, 1.0) * (room < -0.2)
    blocked = room < 0.08
    return _Cave(mujoco.MjSpec(), plan, flat.with_heights(bed + fine + wall), room, flat.with_heights(bed), blocked)


def _floor(rng: np.random.Generator, cave: _Cave) -> Canvas:
    """Earth and rock, wet in the hollows, bare along the walls; as large as the ground."""
    low, high = cave.ground.extent
    canvas = Canvas(float(high[0] - low[0]), float(high[1] - low[1]), 58.0, (146, 132, 112))
    shape = canvas.pixels.shape[:2]
    canvas.mottle(rng, canvas.box, 0.22, 3.0, 8)
    patch = fractal(rng, shape, 2.2 * canvas.scale, 6)
    canvas.shade(canvas.box, -0.30 * np.clip(4 * (patch - 0.12), 0, 1))
    canvas.shade(canvas.box, -0.35 * np.exp(-((fractal(rng, shape, 1.4 * canvas.scale, 6) / 0.014) ** 2)))
    canvas.speckle(rng, canvas.box, 0.28, 0.06)
    for _ in range(2200):
        x, y, r = rng.uniform(0, canvas.width), rng.uniform(0, canvas.height), rng.uniform(0.015, 0.06)
        canvas.shade((x - r, y - r, x + r, y + r), rng.uniform(-0.3, 0.3))
    return canvas


def _light(rng: np.random.Generator, cave: _Cave) -> None:
    """The sun through the shafts, the only light with shadows; lamps along the passages; and ambient light, as adapted eyes see it."""
    headlight = cave.spec.visual.headlight
    headlight.ambient, headlight.diffuse, headlight.specular = np.full(3, 0.50), np.zeros(3), np.zeros(3)
    way = np.array([*turned([0.32, 0.0], rng.uniform(-np.pi, np.pi)), -1.0])
    sun = cave.spec.worldbody.add_light(name="sun", type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL, castshadow=True)
    sun.pos, sun.dir, sun.diffuse, sun.ambient, sun.specular = -14 * way, way, np.full(3, 0.55), np.zeros(3), np.full(3, 0.1)
    for k, place in enumerate(cave.plan.lamps):
        z = float(cave.bed.height_at(place[None])[0]) + 2.3
        lamp = cave.spec.worldbody.add_light(name=f"lamp{k}", type=mujoco.mjtLightType.mjLIGHT_POINT, castshadow=False)
        lamp.pos, lamp.diffuse, lamp.ambient, lamp.specular = [*place, z], np.array([0.80, 0.74, 0.62]), np.zeros(3), np.full(3, 0.1)
        lamp.attenuation = [0.7, 0.05, 0.03]
        for part, radius, low, high in (("shade", 0.13, 0.12, 0.2), ("cord", 0.012, 0.2, 2.0)):
            size, middle = [radius, (high - low) / 2, 0], [*place, z + (low + high) / 2]
            geom = cave.spec.worldbody.add_geom(name=f"lamp{k}-{part}", type=mujoco.mjtGeom.mjGEOM_CYLINDER, size=size, pos=middle, group=1)
            geom.material, geom.castshadow = "glow" if part == "shade" else "", False
            geom.rgba = (1.0, 0.95, 0.8, 1.0) if part == "shade" else (0.1, 0.1, 0.1, 1.0)
            geom.contype = geom.conaffinity = 0


def _vault(rng: np.random.Generator, cave: _Cave) -> None:
    """The vault springs from the walls and is higher where there is more room; shafts are holes in it."""
    grid = Heightfield.flat(cave.plan.extent, VAULT_SPACING)
    nodes = grid.nodes
    room = cave.plan.room(nodes)
    under = cave.bed.height_at(nodes.reshape(-1, 2)).reshape(room.shape)
    rough = np.clip(room + 0.1, 0, 1) * (swell(rng, nodes, 2.2, 0.22) + swell(rng, nodes, 1.0, 0.18))
    height = under + _headroom(room) + rough
    inside = np.maximum.reduce([room[:-1, :-1], room[1:, :-1], room[:-1, 1:], room[1:, 1:]])
    closed = inside > -1.0
    middle = 0.25 * (nodes[:-1, :-1] + nodes[1:, :-1] + nodes[:-1, 1:] + nodes[1:, 1:])
    for place, radius in cave.plan.shafts:
        closed &= np.hypot(*np.moveaxis(middle - place, -1, 0)) > radius
    for k, piece in enumerate(Ceiling(grid.with_heights(height), closed).tiles(9, 0.6)):
        geom = cave.stand(piece, f"vault{k}", np.zeros(3))
        # Nothing that moves gets so high, and the convex hull of a vault would fill the space under it.
        geom.contype = geom.conaffinity = 0


def _headroom(room: Array) -> Array:
    """m from the floor to the vault, by the m of room to the nearest wall: 0.35 m at its lowest, in the rock."""
    return 0.35 + 2.05 * np.clip(room + 0.5, 0, None) ** 0.42


def _pillars(rng: np.random.Generator, cave: _Cave) -> None:
    """Rock pillars in the halls, narrow in the middle, from the floor into the vault: two stones each, base and top."""
    angle = np.linspace(0, 2 * np.pi, 9, endpoint=False)
    ring = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    for k, (place, radius) in enumerate(cave.plan.pillars):
        z = float(cave.bed.height_at(place[None])[0])
        top = float(_headroom(cave.plan.room(place[None]))[0]) + SOLE
        levels = zip((-SOLE, 0.4, rng.uniform(1.3, 1.9), 2.6, top), (1.3, 1.1, 0.74, 0.9, 1.6), strict=True)
        rings = [np.column_stack([ring * radius * wide * rng.uniform(0.88, 1.1, (9, 1)), np.full(9, height)]) for height, wide in levels]
        for part, points in (("base", rings[:3]), ("top", rings[2:])):
            cave.stand(hull(np.concatenate(points), 3.1 * place), f"pillar{k}-{part}", np.array([*place, z]))
        cave.blocked[np.hypot(*np.moveaxis(cave.ground.nodes - place, -1, 0)) < 1.2 * radius] = True


def _bridges(rng: np.random.Generator, cave: _Cave) -> list[str]:
    """A slab over each ditch; its top is hardly above the ground on both sides, so that wheels get onto it."""
    names = []
    for k, (place, yaw) in enumerate(cave.plan.bridges):
        z = float(cave.bed.height_at(place[None])[0]) + 0.03
        geom = cave.stand(slab(rng, BRIDGE, 0.05), f"deck{k}", np.array([*place, z]), yaw)
        geom.group = 0
        names.append(geom.name)
    return names


def _ledges(rng: np.random.Generator, cave: _Cave, difficulty: float) -> list[str]:
    """Ledges of rock: high ones over the passage, and low ones, whose places are blocked."""
    names = []
    for k, (place, yaw, high) in enumerate(cave.plan.ledges):
        z = float(cave.bed.height_at(place[None])[0])
        reach = rng.uniform(1.0, 1.5) if high else rng.uniform(0.5, 0.7 + 0.2 * difficulty)
        width, thick = rng.uniform(1.3, 2.2), rng.uniform(0.35, 0.6)
        up = rng.uniform(2.15, 2.3) if high else rng.uniform(0.75, 1.3)
        geom = cave.stand(ledge(rng, (reach, width, thick)), f"ledge{k}", np.array([*place, z + up]), yaw)
        names.append(geom.name)
        if not high:
            middle = place + turned([reach / 2, 0], yaw)
            cave.blocked[covered(cave.ground, rectangle(middle, (reach, width + 0.1), yaw), 0.1)] = True
    return names


def _stones(rng: np.random.Generator, cave: _Cave, difficulty: float) -> None:
    """Fallen stones at the foot of the walls; more with difficulty."""
    i, j = np.nonzero((cave.room > 0.05) & (cave.room < 0.3))
    spots = cave.ground.nodes[i, j]
    for k in range(min(round(26 + 26 * difficulty), len(spots))):
        place = spots[int(rng.integers(len(spots)))]
        size = rng.uniform(0.12, 0.34) * rng.uniform(0.7, 1.3, 3)
        cloud = rng.normal(size=(16, 3))
        cloud *= size / np.linalg.norm(cloud, axis=1, keepdims=True)
        z = float(cave.ground.height_at(place[None])[0]) + 0.25 * size[2]
        cave.stand(hull(cloud, rng.uniform(0, 8, 2)), f"rock{k}", np.array([*place, z]))
        cave.blocked[np.hypot(*np.moveaxis(cave.ground.nodes - place, -1, 0)) < size.max()] = True
