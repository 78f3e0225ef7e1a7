"""A crossing of roads between lawns on a campus, in the world frame of PETS 2009, so that its cameras and its people's paths fit.

At difficulty 0 the ground is level at z = 0 and nothing stands on the paths or between them and the cameras. With
difficulty the lawns rise over kerbs, which are lowered here and there. The ground slopes and heaves, and trees and posts occlude people.
"""

from __future__ import annotations

import numpy as np

from worlds.engine import mujoco
from worlds.props.meshes import PERIOD
from worlds.scenes import campus_objects as plan
from worlds.scenes.campus_objects import CampusSite, Colour, buildings, furniture, posts, ramp, surroundings, trees
from worlds.terrain.free_space import spawn_areas, walkers_spaces
from worlds.terrain.heightfield import Array, Heightfield, Mask
from worlds.terrain.polygons import signed_distance
from worlds.terrain.relief import fractal, swell
from worlds.terrain.walk_surface import Decks, Terrain
from worlds.textures.masonry import brick, rock
from worlds.textures.materials import Canvas, add_material, add_open_air
from worlds.world import World

NAME = "campus"
SPACING = 0.22
RIM = 1.2
"""m: width of the blocked border."""
PIXELS = 36.0
"""Pixels per metre of the ground's texture."""
FREE_FOR_FEET, FREE_FOR_WHEELS = 1000.0, 600.0
"""m²: least free area of people and of rovers."""


def build(rng: np.random.Generator, difficulty: float = 0.5) -> World:
    """The campus; seeds differ in ground, trees and light. Raises ValueError if people or rovers have too little free space."""
    ground = _ground(rng, difficulty)
    low, high = plan.EXTENT
    site = CampusSite(mujoco.MjSpec(), ground, np.minimum(ground.nodes - low, high - ground.nodes).min(axis=2) < RIM)
    spec = site.spec
    spec.modelname = NAME
    _materials(rng, spec)
    add_material(spec, "ground", _lawns_and_roads(rng, ground), 0.05)
    add_open_air(spec, rng, ground, ((0.55, 0.69, 0.86), (0.86, 0.89, 0.92)), 0.7)
    # Grass without end or feature, so that the lawns do not end in the sky.
    far = site.box("ground1", (-140, -140, -1.2), (140, 140, -0.3), (0.33, 0.42, 0.20))
    far.contype = far.conaffinity = 0
    far.castshadow = False
    buildings(site)
    furniture(rng, site, difficulty)
    decks = ramp(rng, site, difficulty)
    trees(rng, site, difficulty)
    posts(rng, site, difficulty)
    surroundings(rng, site)
    terrain = Terrain(ground, Decks.of(spec, decks))
    feet, wheels = walkers_spaces(NAME, terrain.on_grid, site.blocked, (FREE_FOR_FEET, FREE_FOR_WHEELS))
    return World(NAME, spec, ground, feet, wheels, spawn_areas(feet, rng, 6), terrain.decks)


def _ground(rng: np.random.Generator, difficulty: float) -> Heightfield:
    """Level at difficulty 0; else with kerbs, lowered here and there, a slope and mounds on the lawns. The very edge is 0.4 m lower."""
    flat = Heightfield.flat(plan.EXTENT, SPACING)
    nodes = flat.nodes
    road = np.minimum(signed_distance(nodes, plan.ROAD), signed_distance(nodes, plan.CAR_PARK))
    ramps = np.minimum.reduce([np.linalg.norm(nodes - place, axis=-1) for place in plan.KERB_RAMPS])
    width = np.where(ramps < 1.3, 1.4, SPACING)
    kerb = (0.02 + 0.11 * difficulty) * (difficulty > 0) * np.clip(road / width, 0, 1)
    lawn = np.clip((road - 0.8) / 3.0, 0, 1)
    built = np.minimum(signed_distance(nodes, plan.BUILDING), signed_distance(nodes, plan.HUT))
    lawn *= np.clip((built - 1.0) / 3.0, 0, 1)
    mounds = lawn * difficulty * (np.clip(swell(rng, nodes, 8.0, 2.2) - 0.2, 0, None) + swell(rng, nodes, 2.6, 0.13) + swell(rng, nodes, 1.1, 0.04))
    slope = difficulty * (swell(rng, nodes, 22.0, 0.7) + swell(rng, nodes, 4.0, 0.05))
    low, high = plan.EXTENT
    rim = np.minimum(nodes - low, high - nodes).min(axis=2)
    sunk = np.clip(1 - rim / 0.7, 0, 1)
    return flat.with_heights((kerb + mounds + np.maximum(slope, -0.2)) * np.clip(rim / 5.0, 0, 1) - 0.4 * sunk)


def _materials(rng: np.random.Generator, spec: mujoco.MjSpec) -> None:
    add_material(spec, "brick", brick(rng, PERIOD, PERIOD, 0.0), 0.05)
    add_material(spec, "stone", rock(rng, (166, 162, 152), PERIOD / 2), 0.05)
    bark = Canvas(PERIOD / 2, PERIOD / 2, 100.0, (96, 80, 62))
    bark.mottle(rng, bark.box, 0.45, 0.25, 5)
    add_material(spec, "bark", bark, 0.02)
    leaves = Canvas(PERIOD / 2, PERIOD / 2, 100.0, (74, 104, 46))
    leaves.mottle(rng, leaves.box, 0.55, 0.6, 6)
    leaves.speckle(rng, leaves.box, 0.7, 0.25)
    add_material(spec, "leaves", leaves, 0.02)


def _lawns_and_roads(rng: np.random.Generator, ground: Heightfield) -> Canvas:
    """Light asphalt with patches and cracks, kerbs painted or built, yellow lines along them, bays of the car park, grass."""
    low, high = ground.extent
    width, height = (float(n) for n in high - low)
    canvas = Canvas(width, height, PIXELS, (84, 108, 48))
    shape = canvas.pixels.shape[:2]
    dry = np.clip(0.35 + 1.6 * fractal(rng, shape, 5.0 * PIXELS, 7), 0, 1)[..., None]
    canvas.pixels += dry * (np.array([116, 118, 62], dtype=np.float32) - canvas.pixels)
    coarse = tuple(n // 5 + 1 for n in shape)
    y, x = np.linspace(high[1], low[1], coarse[0]), np.linspace(low[0], high[0], coarse[1])
    nodes = np.stack(np.meshgrid(x, y), axis=-1)
    road, park = (_enlarged(signed_distance(nodes, polygon), shape) for polygon in (plan.ROAD, plan.CAR_PARK))

    def paint(where: Mask, colour: Colour, opacity: float = 1.0) -> None:
        canvas.pixels[where] += np.float32(opacity) * (np.array(colour, dtype=np.float32) - canvas.pixels[where])

    paint(np.minimum(road, park) < 0.14, (176, 172, 162))
    paint(park < 0, (126, 124, 122))
    paint(road < 0, (156, 156, 158))
    for edge in (-0.32, -0.52):
        paint((np.abs(road - edge) < 0.045) & (park > 0.2), (212, 186, 84), 0.75)
    for bay in np.arange(-4.4, 1.7, 2.45):
        canvas.fill((bay - low[0], 7.0 - low[1], bay + 0.08 - low[0], 11.4 - low[1]), (214, 212, 206), 0.8)
    for _ in range(34):
        a, b = rng.uniform(0, width - 3), rng.uniform(0, height - 3)
        box = (a, b, a + rng.uniform(0.5, 2.6), b + rng.uniform(0.4, 1.6))
        patch = canvas.window(box)
        grey = np.abs(patch[..., 0] - patch[..., 2]) < 12
        patch[grey] *= np.float32(rng.uniform(0.78, 1.08))
    cracks = np.exp(-((fractal(rng, shape, 2.6 * PIXELS, 6) / 0.008) ** 2)) * (np.minimum(road, park) < 0)
    canvas.shade(canvas.box, -0.35 * cracks)
    canvas.mottle(rng, canvas.box, 0.16, 2.0, 8)
    canvas.speckle(rng, canvas.box, 0.22, 0.12)
    return canvas


def _enlarged(coarse: Array, shape: tuple[int, int]) -> Array:
    """A pattern, interpolated bilinearly on a finer grid with the same corners."""
    rows, columns = (np.linspace(0, n - 1, m) for n, m in zip(coarse.shape, shape, strict=True))
    along = np.stack([np.interp(columns, np.arange(coarse.shape[1]), row) for row in coarse])
    i = np.minimum(rows.astype(np.int64), coarse.shape[0] - 2)
    return along[i] + (rows - i)[:, None] * (along[i + 1] - along[i])
