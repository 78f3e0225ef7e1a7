"""Common parts of outdoor worlds: an embankment around them, sun and sky, objects with gaps between them, and free space."""

from __future__ import annotations

from collections.abc import Callable
from typing import final

import numpy as np
from numpy.typing import ArrayLike
from scipy import ndimage

from worlds.engine import mujoco
from worlds.props.plants import Plant
from worlds.props.shapes import Shape
from worlds.terrain.free_space import spawn_areas, walkers_spaces
from worlds.terrain.heightfield import Array, Heightfield, Mask
from worlds.terrain.relief import swell
from worlds.textures.materials import FAIR_SKY, Canvas, add_material, add_open_air
from worlds.world import World

RIM = 3.0
"""m: width of the embankment; its outer part is blocked."""
ENTRANCES = 4


def embankment(rng: np.random.Generator, nodes: Array, half: float, height: float) -> Array:
    """Heights (rows, columns) m of a bank along a square of half side `half` m: 0 inside, about `height` m at the edge, with uneven ground."""
    # Its foot is irregular, so that the world is no square.
    beyond = np.abs(nodes).max(axis=2) - (half - RIM) + swell(rng, nodes, 6.0, 0.8)
    share = np.clip(beyond / RIM, 0, 1)
    return height * share**1.3 + share * swell(rng, nodes, 3.0, 0.3 * height)


@final
class OutdoorSite:
    """An outdoor scene under construction, with a mask of occupied grid points."""

    def __init__(self, name: str, ground: Heightfield, half: float) -> None:
        """half: half of the square's side, m."""
        self.name, self.ground = name, ground
        self.spec = mujoco.MjSpec()
        self.spec.modelname = name
        self.nodes = ground.nodes
        self.blocked: Mask = np.abs(self.nodes).max(axis=2) > half - 0.6 * RIM
        self._count: dict[str, int] = {}

    def paint(self, pictures: dict[str, Canvas], rng: np.random.Generator) -> None:
        """Add materials by name, among them the ground's, a fair sky, and a sun of random azimuth."""
        for material, canvas in pictures.items():
            add_material(self.spec, material, canvas, 0.04)
        add_open_air(self.spec, rng, self.ground, FAIR_SKY, 0.75)

    def name_of(self, kind: str) -> str:
        """The next name of a kind: rock0, rock1 …"""
        number = self._count.get(kind, 0)
        self._count[kind] = number + 1
        return f"{kind}{number}"

    def spots(self, rng: np.random.Generator, count: int, gap: float, where: Mask | None = None) -> Array:
        """At most `count` places (k, 2) m, at least `gap` m from each other and from objects; where: mask of grid points that may be chosen."""
        room = ndimage.distance_transform_edt(~self.blocked) * self.ground.spacing > gap
        candidates = rng.permutation(self.nodes[room if where is None else room & where])
        return _apart(candidates, count, gap)

    def rim(self, rng: np.random.Generator, count: int, gap: float) -> Array:
        """At most `count` places (k, 2) m on the embankment, at least `gap` m apart."""
        low, high = self.ground.extent
        edge = np.minimum(self.nodes - low, high - self.nodes).min(axis=2)
        candidates = rng.permutation(self.nodes[self.blocked & (edge > 0.3) & (edge < 0.6 * RIM)])
        return _apart(candidates, count, gap)

    def block(self, place: ArrayLike, radius: float) -> None:
        """Mark a disc of that radius m around place (2,) m as occupied."""
        self.blocked |= np.hypot(*np.moveaxis(self.nodes - np.asarray(place), -1, 0)) <= radius + 0.5 * self.ground.spacing

    def plant(self, rng: np.random.Generator, kind: str, make: Callable[[np.random.Generator], Plant], places: Array) -> None:
        """Put plants in the ground at places (k, 2) m, with random yaws, and block where they stand."""
        for place in places:
            plant, yaw = make(rng), rng.uniform(-np.pi, np.pi)
            plant.stand(self.spec, self.name_of(kind), [*place, self.ground.lowest_around(place, plant.radius)], yaw)
            self.block(place, plant.radius)

    def stone(self, shape: Shape, place: Array, sunk: float) -> None:
        """Put a stone down, `sunk` of its lower half in the ground, and block where it lies."""
        low, high = shape.vertices.min(axis=0), shape.vertices.max(axis=0)
        radius = 0.42 * float(np.hypot(*(high - low)[:2]))
        z = self.ground.lowest_around(place, 0.7 * radius) - low[2] * (1 - sunk)
        shape.add_to(self.spec, self.name_of("rock"), "stone", [*place, z])
        self.block(place, radius)

    def world(self, rng: np.random.Generator, feet_area: float, wheels_area: float) -> World:
        """The finished world. Raises ValueError if people or rovers have less free space than these areas, m²."""
        feet, wheels = walkers_spaces(self.name, self.ground, self.blocked, (feet_area, wheels_area))
        return World(self.name, self.spec, self.ground, feet, wheels, spawn_areas(feet, rng, ENTRANCES))


def _apart(candidates: Array, count: int, gap: float) -> Array:
    """At most `count` of the candidates (n, 2) m, in their order, that are at least `gap` m from each other."""
    chosen: list[Array] = []
    while len(chosen) < count and len(candidates):
        chosen.append(candidates[0])
        candidates = candidates[np.hypot(*(candidates - candidates[0]).T) >= gap]
    return np.array(chosen).reshape(-1, 2)
