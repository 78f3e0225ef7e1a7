"""Rolling meadows: hills and hollows, a sunken track with worn edges, rocks in the grass, bushes and single trees."""

from __future__ import annotations

import numpy as np

from worlds.props.meshes import boulder, stone_sizes
from worlds.props.plants import broadleaf, bush, canvases
from worlds.scenes.outdoor_site import OutdoorSite, embankment
from worlds.terrain.heightfield import Array, Heightfield
from worlds.terrain.relief import swell
from worlds.textures.masonry import rock
from worlds.textures.soils import Soil, soil, trail
from worlds.world import World

NAME = "hills"
SPACING, HALF = 0.2, 16.0
MEADOW = Soil((106, 128, 62), (136, 138, 74), (140, 116, 86), 0.42, 4.5)
FREE_FOR_FEET, FREE_FOR_WHEELS = 350.0, 150.0
"""m²: least free area of people and of rovers."""


def build(rng: np.random.Generator, difficulty: float = 0.5) -> World:
    """Hills; seeds differ. Raises ValueError if people or rovers have too little free space."""
    flat = Heightfield.flat([[-HALF, -HALF], [HALF, HALF]], SPACING)
    track = _track(rng, flat.nodes)
    ground = flat.with_heights(_heights(rng, flat.nodes, track, difficulty))
    site = OutdoorSite(NAME, ground, HALF)
    picture = soil(rng, ground, MEADOW)
    trail(picture, track, (142, 120, 90), 0.9)
    site.paint({"ground": picture, "stone": rock(rng, (150, 146, 136)), **canvases(rng, rng.uniform(0, 0.35))}, rng)
    site.plant(rng, "tree", lambda r: broadleaf(r, r.uniform(4.5, 7.5)), site.rim(rng, 34, 2.2))
    beside = track > 1.6
    site.plant(rng, "tree", lambda r: broadleaf(r, r.uniform(4.0, 6.5)), site.spots(rng, 6 + round(5 * difficulty), 2.6, beside))
    site.plant(rng, "bush", lambda r: bush(r, r.uniform(0.7, 1.7)), site.spots(rng, 8 + round(14 * difficulty), 1.6, beside))
    sizes = stone_sizes(rng, 10 + round(22 * difficulty), 0.22, 0.9)
    for place, size in zip(site.spots(rng, len(sizes), 1.2, beside), sizes, strict=False):
        site.stone(boulder(rng, size), place, 0.45)
    return site.world(rng, FREE_FOR_FEET, FREE_FOR_WHEELS)


def _track(rng: np.random.Generator, nodes: Array) -> Array:
    """Distance (rows, columns) m from the centre line of a track that winds across the world."""
    yaw = rng.uniform(-np.pi, np.pi)
    along, across = nodes @ np.array([np.cos(yaw), np.sin(yaw)]), nodes @ np.array([-np.sin(yaw), np.cos(yaw)])
    bend = rng.uniform(2.0, 4.0) * np.sin(along / rng.uniform(4.0, 5.5) + rng.uniform(0, 6))
    return np.asarray(np.abs(across - bend))


def _heights(rng: np.random.Generator, nodes: Array, track: Array, difficulty: float) -> Array:
    z = swell(rng, nodes, 11.0, 0.5 + 0.95 * difficulty) + swell(rng, nodes, 5.0, 0.12 + 0.26 * difficulty)
    # Tussocks, lower on the track.
    worn = np.clip(track / 1.2, 0.25, 1.0)
    z = z + worn * (swell(rng, nodes, 1.6, 0.03 + 0.08 * difficulty) + swell(rng, nodes, 0.7, 0.01 + 0.02 * difficulty))
    # The depth of the track varies; where it is 0, rovers can cross. Its edges are the steps of this world.
    depth = (0.06 + 0.12 * difficulty) * np.clip(0.5 + swell(rng, nodes, 6.0, 1.2), 0, 1)
    z = z - depth * np.clip((1.15 - track) / 0.25, 0, 1)
    return np.asarray(z + embankment(rng, nodes, HALF, 1.6 + 1.2 * difficulty))
