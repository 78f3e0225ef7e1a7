"""A forest: trunks close to each other, roots around them, hollows, fallen stems, stumps, and spots of sunlight."""

from __future__ import annotations

import numpy as np

from worlds.props.meshes import boulder, stone_sizes, tilted
from worlds.props.plants import BARK, Plant, broadleaf, bush, canvases, conifer, log, stump
from worlds.scenes.outdoor_site import OutdoorSite, embankment
from worlds.terrain.heightfield import Array, Heightfield
from worlds.terrain.polygons import covered, rectangle
from worlds.terrain.relief import swell
from worlds.textures.masonry import rock
from worlds.textures.soils import Soil, soil
from worlds.world import World

NAME = "forest"
SPACING, HALF = 0.18, 14.5
FLOOR = Soil((118, 96, 66), (92, 98, 54), (104, 82, 58), 0.5, 2.2)
FREE_FOR_FEET, FREE_FOR_WHEELS = 230.0, 90.0
"""m²: least free area of people and of rovers."""


def build(rng: np.random.Generator, difficulty: float = 0.5) -> World:
    """A forest; seeds differ. Raises ValueError if people or rovers have too little free space."""
    flat = Heightfield.flat([[-HALF, -HALF], [HALF, HALF]], SPACING)
    plan = OutdoorSite(NAME, flat, HALF)
    # The places of trees come first, since roots lift the ground around them.
    stems = plan.spots(rng, 26 + round(26 * difficulty), 1.9 - 0.1 * difficulty)
    ground = flat.with_heights(_heights(rng, flat.nodes, stems, difficulty))
    site = OutdoorSite(NAME, ground, HALF)
    leaves = canvases(rng, rng.uniform(0, 0.6))
    site.paint({"ground": soil(rng, ground, FLOOR), "stone": rock(rng, (118, 122, 104)), **leaves}, rng)
    site.plant(rng, "tree", _tree, np.concatenate([stems, site.rim(rng, 60, 1.7)]))
    for place in site.spots(rng, 3 + round(6 * difficulty), 1.3):
        _fallen(rng, site, place)
    site.plant(rng, "stump", stump, site.spots(rng, 4 + round(6 * difficulty), 1.2))
    site.plant(rng, "bush", lambda r: bush(r, r.uniform(0.5, 1.3)), site.spots(rng, 4 + round(10 * difficulty), 1.4))
    sizes = stone_sizes(rng, 5 + round(10 * difficulty), 0.16, 0.55)
    for place, size in zip(site.spots(rng, len(sizes), 1.1), sizes, strict=False):
        site.stone(boulder(rng, size), place, 0.5)
    return site.world(rng, FREE_FOR_FEET, FREE_FOR_WHEELS)


def _tree(rng: np.random.Generator) -> Plant:
    height = rng.uniform(6.0, 10.5)
    return conifer(rng, height) if rng.uniform() < 0.55 else broadleaf(rng, 0.85 * height)


def _heights(rng: np.random.Generator, nodes: Array, stems: Array, difficulty: float) -> Array:
    z = swell(rng, nodes, 8.0, 0.2 + 0.6 * difficulty) + swell(rng, nodes, 2.6, 0.05 + 0.12 * difficulty)
    z = z + swell(rng, nodes, 0.8, 0.01 + 0.02 * difficulty)
    for _ in range(3 + round(7 * difficulty)):
        # An uprooted tree leaves a dip, and a mound beside it.
        place, wide = rng.uniform(-HALF + 4, HALF - 4, 2), rng.uniform(0.7, 1.3)
        away = rng.uniform(-np.pi, np.pi)
        for sign, middle in ((-1.0, place), (0.6, place + 1.7 * wide * np.array([np.cos(away), np.sin(away)]))):
            r2 = ((nodes - middle) ** 2).sum(axis=2)
            z = z + sign * (0.12 + 0.2 * difficulty) * np.exp(-r2 / (2 * (0.6 * wide) ** 2))
    return np.asarray(z + _roots(rng, nodes, stems, difficulty) + embankment(rng, nodes, HALF, 1.4 + difficulty))


def _roots(rng: np.random.Generator, nodes: Array, stems: Array, difficulty: float) -> Array:
    """Heights (rows, columns) m of ridges that run out from every stem and fade."""
    lift = np.zeros(nodes.shape[:2])
    for stem in stems:
        away = nodes - stem
        reach = np.hypot(away[..., 0], away[..., 1])
        near = reach < 2.2
        angle = np.arctan2(away[..., 1], away[..., 0])[near]
        for start in rng.uniform(-np.pi, np.pi, int(rng.integers(3, 6))):
            bend = start + rng.normal(0, 0.35) * reach[near]
            beside = np.abs(np.angle(np.exp(1j * (angle - bend)))) * reach[near]
            ridge = np.clip(1 - beside / 0.16, 0, 1) * np.clip(1 - reach[near] / rng.uniform(0.9, 2.2), 0, 1)
            lift[near] = np.maximum(lift[near], (0.07 + 0.06 * difficulty) * ridge)
    return lift


def _fallen(rng: np.random.Generator, site: OutdoorSite, place: Array) -> None:
    """A fallen stem, inclined as the ground under its ends."""
    length, radius, yaw = rng.uniform(1.8, 4.0), rng.uniform(0.13, 0.24), rng.uniform(-np.pi, np.pi)
    ahead = np.array([np.cos(yaw), np.sin(yaw)])
    under = covered(site.ground, rectangle(place, (length + 0.2, 2 * radius), yaw), 0.5 * SPACING)
    if site.blocked[under].any():
        return
    ends = site.ground.height_at([place - 0.4 * length * ahead, place + 0.4 * length * ahead])
    slope = float(np.arctan2(ends[1] - ends[0], 0.8 * length))
    shape = tilted(log(rng, length, radius), -slope, 0.0)
    shape.add_to(site.spec, site.name_of("log"), BARK, [*place, float(ends.mean()) + 0.6 * radius], yaw)
    site.blocked |= under
