"""The ruins of a house with many rooms: walls without a roof, arches, doorways, a court of columns, broken paving, rubble.

The ground plan has walls, doorways, and how much of each wall is left.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from worlds.engine import mujoco
from worlds.props.meshes import PERIOD, arch, hull, slab, tilted, wedge
from worlds.props.shapes import Shape
from worlds.terrain.free_space import spawn_areas, walkers_spaces
from worlds.terrain.heightfield import Array, Heightfield, Mask
from worlds.terrain.polygons import covered, offset, rectangle, signed_distance, turned
from worlds.terrain.relief import fractal, rubble, swell
from worlds.terrain.walk_surface import Decks, Terrain
from worlds.textures.masonry import ashlar
from worlds.textures.materials import Canvas, add_material, add_open_air
from worlds.world import World

THICKNESS = 0.5
SPRING, RING, PIER = 1.95, 0.34, 0.5
"""m: height at which an arch springs, thickness of its ring, and length of the walls on which it stands."""
COURT = 9.4
"""m from the middle to the outer walls."""


@dataclass(frozen=True, eq=False)
class Run:
    """Remains of a wall from start (2,) m along yaw rad: distances along (k,) m, and the height of its top there, top (k,) m."""

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
    """Nine rooms in three rows. Each wall has a doorway, or is missing."""
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
    """A wall with a doorway: under an arch, or a wider gap."""
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


NAME = "ruins"
SPACING, HALF = 0.17, 14.5
BANK = 2.4
"""m: height of the banks around the site."""
FREE_FOR_FEET, FREE_FOR_WHEELS = 180.0, 90.0
"""m²: least free area of people and of rovers."""


@dataclass(frozen=True, eq=False)
class _Site:
    """The ruins under construction. blocked: mask (rows, columns) of grid points under objects; decks: names of slabs that people walk on."""

    spec: mujoco.MjSpec
    plan: RuinsPlan
    ground: Heightfield
    blocked: Mask
    decks: list[str] = field(default_factory=list)

    def stand(self, shape: Shape, name: str, place: ArrayLike, turn: tuple[float, float]) -> mujoco.MjsGeom:
        """Put a shape at place (2,) m; turn: z m of its origin, and yaw rad."""
        x, y = np.asarray(place, dtype=np.float64)
        return shape.add_to(self.spec, name, "stone", [x, y, turn[0]], turn[1])

    def block(self, corners: ArrayLike) -> None:
        self.blocked[covered(self.ground, corners, SPACING / 2)] = True


def build(rng: np.random.Generator, difficulty: float = 0.5) -> World:
    """Ruins; seeds differ. Raises ValueError if people or rovers have too little free space."""
    plan = draw(rng, difficulty)
    heaps = _heaps(rng, plan, difficulty)
    ground = _ground(rng, plan, heaps, difficulty)
    site = _Site(mujoco.MjSpec(), plan, ground, np.abs(ground.nodes).max(axis=2) > HALF - 2.2)
    site.spec.modelname = NAME
    add_material(site.spec, "stone", ashlar(rng, (186, 172, 146)), 0.05)
    add_material(site.spec, "ground", _soil(rng, plan, ground), 0.05)
    add_open_air(site.spec, rng, ground, ((0.42, 0.60, 0.84), (0.84, 0.88, 0.92)), 0.85)
    _walls(rng, site)
    _columns(rng, site)
    _paving(rng, site, difficulty)
    _stones(rng, site, heaps)
    terrain = Terrain(ground, Decks.of(site.spec, site.decks))
    feet, wheels = walkers_spaces(NAME, terrain.on_grid, site.blocked, (FREE_FOR_FEET, FREE_FOR_WHEELS))
    return World(NAME, site.spec, ground, feet, wheels, spawn_areas(feet, rng, 4), terrain.decks)


def _heaps(rng: np.random.Generator, plan: RuinsPlan, difficulty: float) -> list[tuple[Array, float, float]]:
    """Heaps of fallen walls: place (2,), radius and height m, beside walls and never under an arch."""
    heaps: list[tuple[Array, float, float]] = []
    for _ in range(200):
        run = plan.runs[int(rng.integers(len(plan.runs)))]
        side = rng.choice([-1.0, 1.0])
        place = run.start + turned([rng.uniform(run.along[0], run.along[-1]), side * rng.uniform(0.4, 1.0)], run.yaw)
        radius = rng.uniform(0.8, 1.3 + 0.5 * difficulty)
        free = all(np.hypot(*(place - middle)) > radius + 1.3 for middle, _, _ in plan.arches)
        open_way = all(np.hypot(*(place - other)) > radius + r + 0.6 for other, r, _ in heaps)
        if free and open_way and run.along[-1] - run.along[0] > 1:
            heaps.append((place, radius, rng.uniform(0.25, 0.5 + 0.5 * difficulty)))
        if len(heaps) >= 6 + round(8 * difficulty):
            break
    return heaps


def _ground(rng: np.random.Generator, plan: RuinsPlan, heaps: list[tuple[Array, float, float]], difficulty: float) -> Heightfield:
    """Uneven earth, a terrace with two steps, heaps, and banks all around."""
    flat = Heightfield.flat([[-HALF, -HALF], [HALF, HALF]], SPACING)
    nodes = flat.nodes
    z = swell(rng, nodes, 7.0, 0.05 + 0.30 * difficulty)
    z += swell(rng, nodes, 1.7, 0.012 + 0.06 * difficulty) + swell(rng, nodes, 0.7, 0.02 * difficulty)
    rise = 0.11 + 0.05 * difficulty
    for step in range(2):
        inner = signed_distance(nodes, plan.rooms[plan.terrace]) + 0.9 + 0.45 * step
        z += rise * np.clip(0.5 - inner / SPACING, 0, 1)
    for place, radius, height in heaps:
        z += rubble(rng, nodes, place, radius, height)
    beyond = np.abs(nodes).max(axis=2) - (HALF - 2.6)
    z += BANK * np.clip(beyond / 2.6, 0, 1) ** 1.4 + np.clip(beyond, 0, 1) * swell(rng, nodes, 2.5, 0.4)
    return flat.with_heights(z)


def _soil(rng: np.random.Generator, plan: RuinsPlan, ground: Heightfield) -> Canvas:
    """Dry grass and earth, with remains of stone floors in the rooms."""
    low, high = ground.extent
    canvas = Canvas(float(high[0] - low[0]), float(high[1] - low[1]), 58.0, (150, 132, 100))
    shape = canvas.pixels.shape[:2]
    green = np.clip(0.5 + 2.6 * fractal(rng, shape, 3.0 * canvas.scale, 7), 0, 1)[..., None]
    canvas.pixels += green * (np.array([112, 120, 66], dtype=np.float32) - canvas.pixels)
    worn = fractal(rng, shape, 1.6 * canvas.scale, 6) > -0.10
    plain = canvas.pixels.copy()
    for room in plan.rooms:
        for x in np.arange(*(room[:, 0].min() - low[0], room[:, 0].max() - low[0], 0.62)):
            for y in np.arange(*(room[:, 1].min() - low[1], room[:, 1].max() - low[1], 0.46)):
                dx, dy = rng.uniform(0, 0.05, 2)
                canvas.fill((x + dx, y + dy, x + 0.60, y + 0.44), np.array([168, 158, 138]) * rng.uniform(0.75, 1.15))
    y, x = np.linspace(high[1], low[1], shape[0]), np.linspace(low[0], high[0], shape[1])
    inside = signed_distance(np.stack(np.meshgrid(x, y), axis=-1), rectangle([0, 0], [2 * COURT, 2 * COURT], plan.yaw)) < -0.2
    canvas.pixels[:] = np.where((inside & worn)[..., None], canvas.pixels, plain)
    canvas.mottle(rng, canvas.box, 0.26, 2.0, 8)
    canvas.speckle(rng, canvas.box, 0.22, 0.08)
    return canvas


def _walls(rng: np.random.Generator, site: _Site) -> None:
    """Walls in convex pieces, and the arches over doorways."""
    sink = 0.4
    for k, run in enumerate(site.plan.runs):
        z = site.ground.lowest_around(run.start + turned([run.along.mean(), 0], run.yaw), 0.5 * np.ptp(run.along) * 0.7)
        shift = rng.uniform(0, PERIOD, 2)
        for part in range(len(run.along) - 1):
            (x0, x1), (h0, h1) = run.along[part : part + 2], run.top[part : part + 2]
            bump = (x0 + rng.uniform(0.3, 0.7) * (x1 - x0), max(h0, h1) + rng.uniform(-0.05, 0.15))
            profile = [(x0, -sink), (x1, -sink), (x1, h1), (x0, h0)]
            if len(run.along) > 2:
                profile.append(bump)
            site.stand(wedge(profile, THICKNESS, shift), f"wall{k}-{part}", run.start, (z, run.yaw))
        site.block(run.corners())
    for k, (middle, yaw, span) in enumerate(site.plan.arches):
        z = site.ground.lowest_around(middle, 1.0)
        for part, stone in enumerate(arch(span, SPRING, RING, THICKNESS + 0.06)):
            site.stand(stone, f"arch{k}-{part}", middle, (z, yaw))


def _columns(rng: np.random.Generator, site: _Site) -> None:
    """Two rows of columns in the court: some stand, some are stumps, some lie beside their place."""
    room = site.plan.rooms[site.plan.court]
    number = 0
    for u in (0.28, 0.72):
        for v in (0.2, 0.5, 0.8):
            place = room[0] + u * (room[1] - room[0]) + v * (room[3] - room[0])
            r, state = rng.uniform(0.24, 0.3), rng.uniform()
            z = site.ground.lowest_around(place, r)
            height = rng.uniform(0.4, 0.8) if state > 0.55 else rng.uniform(2.2, 3.2)
            site.stand(_drum(rng, (1.25 * r, 1.25 * r), (-0.3, 0.16)), f"column{number}-foot", place, (z, 0.0))
            site.stand(_drum(rng, (r, 0.88 * r if height > 1 else r), (0.16, height)), f"column{number}-shaft", place, (z, 0.0))
            site.block(rectangle(place, [2.5 * r] * 2))
            if state > 0.75:
                _fallen(rng, site, place, (r, number))
            number += 1


def _drum(rng: np.random.Generator, radii: tuple[float, float], levels: tuple[float, float]) -> Shape:
    """A round stone, upright: radii m and heights m of its two ends."""
    angle = np.linspace(0, 2 * np.pi, 14, endpoint=False)
    ring = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    ends = [np.column_stack([ring * r, np.full(14, z) + rng.uniform(-0.02, 0.02)]) for r, z in zip(radii, levels, strict=True)]
    return hull(np.concatenate(ends), rng.uniform(0, PERIOD, 2))


def _fallen(rng: np.random.Generator, site: _Site, place: Array, what: tuple[float, int]) -> None:
    """The drums of a fallen column in a row, sunk by a fifth of their diameter."""
    r, number = what
    yaw, reach = rng.uniform(-np.pi, np.pi), 0.75
    for part in range(2):
        length = rng.uniform(0.6, 0.9)
        middle = place + turned([reach + length / 2, rng.uniform(-0.08, 0.08)], yaw)
        lying = tilted(_drum(rng, (r, 0.96 * r), (-length / 2, length / 2)), np.pi / 2, 0.0)
        turn = yaw + rng.uniform(-0.15, 0.15)
        site.stand(lying, f"column{number}-drum{part}", middle, (site.ground.lowest_around(middle, r) + 0.6 * r, turn))
        site.block(rectangle(middle, (length, 2 * r), turn))
        reach += length + 0.12


def _paving(rng: np.random.Generator, site: _Site, difficulty: float) -> None:
    """Slabs of the old floors, lifted and tilted, that people walk on."""
    nodes = site.ground.nodes
    inside = (np.abs(nodes).max(axis=2) < COURT + 1.5) & ~site.blocked
    i, j = np.nonzero(inside)
    for k in range(14 + round(16 * difficulty)):
        pick = int(rng.integers(len(i)))
        place, yaw = nodes[i[pick], j[pick]], rng.uniform(-np.pi, np.pi)
        length, width = rng.uniform(0.9, 1.7), rng.uniform(0.7, 1.2)
        under = covered(site.ground, offset(rectangle(place, (length, width), yaw), 0.1))
        if (site.blocked & under).any() or np.ptp(site.ground.heights[under]) > 0.25:
            continue
        lean = 0.015 + 0.07 * difficulty
        stone = tilted(slab(rng, (length, width, 0.35), 0.12), *rng.uniform(-lean, lean, 2))
        level = float(np.median(site.ground.heights[under])) + rng.uniform(0.01, 0.03 + 0.06 * difficulty)
        geom = site.stand(stone, f"deck{k}", place, (level, yaw))
        geom.group = 0
        site.decks.append(geom.name)


def _stones(rng: np.random.Generator, site: _Site, heaps: list[tuple[Array, float, float]]) -> None:
    """Stones of the fallen walls on their heaps."""
    number = 0
    for place, radius, _ in heaps:
        for _ in range(int(rng.integers(2, 5))):
            spot = place + rng.uniform(-0.6, 0.6, 2) * radius
            size = rng.uniform(0.12, 0.26, 3) * np.array([1.3, 1.0, 0.8])
            corners = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * size * rng.uniform(0.75, 1.05, (8, 3))
            stone = tilted(hull(corners, rng.uniform(0, PERIOD, 2)), *rng.uniform(-0.4, 0.4, 2))
            yaw = rng.uniform(-np.pi, np.pi)
            site.stand(stone, f"rock{number}", spot, (site.ground.lowest_around(spot, 0.1) + 0.5 * size[2], yaw))
            site.block(rectangle(spot, 2 * size[:2], yaw))
            number += 1
