"""Placement of distractors in a ready world: beside the ways of people, without closing any."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy import ndimage

from worlds.props.distractors import MAKERS
from worlds.props.furniture import SINK
from worlds.terrain.free_space import FEET, WHEELS, FreeSpace
from worlds.terrain.heightfield import Array, Mask
from worlds.terrain.polygons import signed_distance
from worlds.textures.furniture_atlas import atlas
from worlds.textures.materials import add_material
from worlds.textures.person_pictures import pictures
from worlds.world import World

MATERIAL, PICTURES = "distractors", "person_pictures"
SPAWN_MARGIN = 0.6
"""m: distance from the spawn areas."""
LEVEL = 0.12
"""m: largest height difference of the ground under a distractor."""
LEAST_REMAINING = 0.98
"""Share of free space, less the footprint's own surroundings, that must stay connected."""
TRIES = 80


def with_distractors(world: World, rng: np.random.Generator, count: int) -> World:
    """The world with `count` distractors on the free space of feet; the same world for 0.

    Kinds follow each other in random order. The free spaces of feet and wheels are smaller by their footprints and stay connected.
    Raises ValueError where fewer than `count` fit.
    """
    if not count:
        return world
    spec = world.spec.copy()
    add_material(spec, MATERIAL, atlas(rng))
    add_material(spec, PICTURES, pictures(rng))
    feet, wheels = world.feet, world.wheels
    for number in range(count):
        piece = MAKERS[int(rng.integers(len(MAKERS)))](rng)
        for _ in range(TRIES):
            place, yaw = _draw(rng, feet), float(rng.uniform(-np.pi, np.pi))
            corners = piece.footprint(place, yaw)
            heights = world.terrain.height_at(np.concatenate([corners, [place]]))
            if np.ptp(heights) > LEVEL or _near_spawn(world.spawn, corners):
                continue
            rest = _without(feet, corners, FEET.half_width), _without(wheels, corners, WHEELS.half_width)
            if rest[0] is not None and rest[1] is not None:
                feet, wheels = rest[0], rest[1]
                on = [*place, float(heights.min()) - SINK]
                piece.shape.add_to(spec, f"{piece.kind}{number}", MATERIAL, on, yaw)
                if piece.picture is not None:
                    piece.picture.add_to(spec, f"{piece.kind}{number}-picture", PICTURES, on, yaw)
                break
        else:
            raise ValueError(f"distractors is {count}, {number} fit into {world.name}")
    return replace(world, spec=spec, feet=feet, wheels=wheels)


def _draw(rng: np.random.Generator, feet: FreeSpace) -> Array:
    i, j = np.nonzero(feet.free)
    k = int(rng.integers(len(i)))
    return feet.origin + feet.spacing * np.array([j[k], i[k]], dtype=np.float64)


def _near_spawn(spawn: Array, corners: Array) -> bool:
    low, high = corners.min(axis=0) - FEET.half_width - SPAWN_MARGIN, corners.max(axis=0) + FEET.half_width + SPAWN_MARGIN
    return bool(((spawn[:, 0] < high) & (spawn[:, 1] > low)).all(axis=1).any())


def _without(space: FreeSpace, corners: Array, half_width: float) -> FreeSpace | None:
    """Free space less a footprint and the walker's half width around it; None where that would cut something off."""
    rows, columns = space.free.shape
    x, y = (space.origin[k] + space.spacing * np.arange(n) for k, n in ((0, columns), (1, rows)))
    taken = signed_distance(np.stack(np.meshgrid(x, y), axis=-1), corners) <= half_width + 0.5 * space.spacing
    left: Mask = space.free & ~taken
    labels, regions = ndimage.label(left)
    if not regions:
        return None
    sizes = np.bincount(labels.ravel())[1:]
    if sizes.max() < LEAST_REMAINING * left.sum():
        return None
    return FreeSpace(labels == 1 + int(np.argmax(sizes)), space.origin, space.spacing)
