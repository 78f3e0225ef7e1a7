"""A quarry: terraces one above the other with broken edges, ramps between them, boulders, and scree below the faces."""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from worlds.props.meshes import PERIOD, boulder, hull, stone_sizes
from worlds.props.plants import bush, canvases
from worlds.scenes.outdoor_site import OutdoorSite, embankment
from worlds.terrain.heightfield import Array, Heightfield, Mask
from worlds.terrain.relief import fractal, swell
from worlds.textures.masonry import rock
from worlds.textures.soils import Soil, soil
from worlds.world import World

NAME = "quarry"
SPACING, HALF = 0.2, 16.0
STONE = Soil((178, 164, 138), (154, 140, 118), (200, 190, 166), 0.5, 3.0)
RISE = (0.35, 0.75)
"""m from one terrace to the next at difficulty 0 and 1."""
FREE_FOR_FEET, FREE_FOR_WHEELS = 260.0, 110.0
"""m²: least free area of people and of rovers."""


def build(rng: np.random.Generator, difficulty: float = 0.5) -> World:
    """A quarry; seeds differ. Raises ValueError if people or rovers have too little free space."""
    flat = Heightfield.flat([[-HALF, -HALF], [HALF, HALF]], SPACING)
    ground, faces = _terraces(rng, flat, difficulty)
    site = OutdoorSite(NAME, ground, HALF)
    site.paint({"ground": soil(rng, ground, STONE), "stone": rock(rng, (186, 174, 150)), **canvases(rng, 0.3)}, rng)
    site.plant(rng, "bush", lambda r: bush(r, r.uniform(0.8, 2.2)), site.rim(rng, 26, 2.4))
    near = ndimage.distance_transform_edt(~faces) * SPACING if faces.any() else np.full(faces.shape, 9.0)
    sizes = stone_sizes(rng, 26 + round(44 * difficulty), 0.16, 1.0)
    scree = (near > 0.4) & (near < 1.6)
    for place, size in zip(site.spots(rng, len(sizes), 0.75, scree), sizes, strict=False):
        site.stone(boulder(rng, size), place, 0.35)
    for place in site.spots(rng, 5 + round(9 * difficulty), 2.2):
        site.stone(boulder(rng, rng.uniform(0.45, 0.95, 3) * [1, 1, 0.85]), place, 0.3)
    for place in site.spots(rng, 3 + round(4 * difficulty), 2.4):
        _blocks(rng, site, place)
    return site.world(rng, FREE_FOR_FEET, FREE_FOR_WHEELS)


def _terraces(rng: np.random.Generator, flat: Heightfield, difficulty: float) -> tuple[Heightfield, Mask]:
    """The ground, and a mask (rows, columns) of its steep faces."""
    nodes, rise = flat.nodes, RISE[0] + (RISE[1] - RISE[0]) * difficulty
    shape = nodes.shape[:2]
    yaw = rng.uniform(-np.pi, np.pi)
    tilt = nodes @ np.array([np.cos(yaw), np.sin(yaw)]) / HALF
    level = 2.0 + 1.4 * tilt + 1.3 * fractal(rng, shape, 13.0 / SPACING, 2)
    # In units of terraces: flat, then rising over an interval that is narrow at a face and wide on a ramp.
    number, part = np.floor(level), level - np.floor(level)
    ramp = np.clip(0.5 + 3.5 * fractal(rng, shape, 7.0 / SPACING, 2), 0, 1)
    wide = 0.04 + 0.9 * ramp**1.5
    climb = np.clip((part - 0.5) / wide + 0.5, 0, 1)
    z = rise * (number + climb * climb * (3 - 2 * climb))
    z = z + swell(rng, nodes, 3.5, 0.04 + 0.12 * difficulty) + swell(rng, nodes, 1.2, 0.015 + 0.05 * difficulty)
    z = z + swell(rng, nodes, 0.5, 0.01 + 0.03 * difficulty)
    faces = np.hypot(*np.gradient(rise * (number + climb), SPACING)) > 0.8
    ground = flat.with_heights(z + embankment(rng, nodes, HALF, 2.4 + 1.2 * difficulty))
    return ground, faces


def _blocks(rng: np.random.Generator, site: OutdoorSite, place: Array) -> None:
    """A stack of one to three hewn blocks."""
    base = rng.uniform((0.45, 0.35, 0.25), (0.75, 0.5, 0.35))
    points = []
    corners = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=np.float64)
    yaw = rng.uniform(-np.pi, np.pi)
    turn = np.array([[np.cos(yaw), -np.sin(yaw), 0], [np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]])
    z = site.ground.lowest_around(place, 0.5)
    for k in range(int(rng.integers(1, 4))):
        size = base * 0.9**k
        block = corners * size * rng.uniform(0.94, 1.0, (8, 3)) @ turn.T
        shift = np.array([*rng.uniform(-0.08, 0.08, 2), 0.0])
        points.append(block)
        shape = hull(block, rng.uniform(0, PERIOD, 2))
        shape.add_to(site.spec, site.name_of("rock"), "stone", [place[0] + shift[0], place[1] + shift[1], z + size[2] - 0.06])
        z += 2 * size[2] - 0.01
    site.block(place, float(np.hypot(*np.concatenate(points)[:, :2].T).max()))
