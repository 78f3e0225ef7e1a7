"""Placement of distractors and of seats on the free space of a complete world, which stays connected."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from worlds.props.distractors import MAKERS
from worlds.props.furniture import SEATINGS, SINK, Piece, single_chair
from worlds.terrain.free_space import FEET, WHEELS, FreeSpace, largest_region
from worlds.terrain.heightfield import Array, Mask
from worlds.terrain.polygons import signed_distance, turned
from worlds.textures.furniture_atlas import atlas
from worlds.textures.materials import add_material
from worlds.textures.person_pictures import pictures
from worlds.world import World

MATERIAL, PICTURES, SEATS = "distractors", "person_pictures", "seats"
"""Names of the materials."""
SPAWN_MARGIN = 0.6
"""m: distance from the spawn areas."""
LEVEL = 0.12
"""m: largest height difference of the ground under a distractor."""
LEAST_REMAINING = 0.98
"""Share of free space, less the footprint's own surroundings, that must stay connected."""
TRIES = 80
CHAIR_TRIES, PIECE_TRIES = 4, 4
"""Numbers of pieces that are drawn for one seat, and for one distractor, before the world counts as full."""


Spaces = tuple[FreeSpace, FreeSpace]
"""Remaining free space of a world while it is furnished, for feet and for wheels."""


def with_distractors(world: World, rng: np.random.Generator, count: int) -> World:
    """The world with `count` distractors on the free space of feet; the same world for 0.

    Kinds are random. The free spaces of feet and wheels shrink by the footprints and stay connected.
    Raises ValueError if fewer than `count` fit.
    """
    if not count:
        return world
    spec, left = world.spec.copy(), (world.feet, world.wheels)
    add_material(spec, MATERIAL, atlas(rng))
    add_material(spec, PICTURES, pictures(rng))
    for number in range(count):
        for _ in range(PIECE_TRIES):
            piece = MAKERS[int(rng.integers(len(MAKERS)))](rng)
            found = next(_places(world, left, rng, piece), None)
            if found is not None:
                break
        else:
            raise ValueError(f"distractors is {count}, {number} fit into {world.name}")
        left, on, yaw = found
        piece.shape.add_to(spec, f"{piece.kind}{number}", MATERIAL, on, yaw)
        if piece.picture is not None:
            piece.picture.add_to(spec, f"{piece.kind}{number}-picture", PICTURES, on, yaw)
    return replace(world, spec=spec, feet=left[0], wheels=left[1])


def with_seats(world: World, rng: np.random.Generator, count: int) -> World:
    """The world with chairs, benches and tables where `count` people or a few more can sit; the same world for 0.

    Free space shrinks as in `with_distractors`. Raises ValueError if fewer than `count` people can sit.
    """
    if not count:
        return world
    spec, left, seats = world.spec.copy(), (world.feet, world.wheels), list(world.seats)
    add_material(spec, SEATS, atlas(rng))
    number, failed = 0, 0
    while len(seats) < count:
        # If a bench or a table has not fitted in, a chair may.
        seating = single_chair(rng) if failed else SEATINGS[int(rng.integers(len(SEATINGS)))](rng)
        for smaller, on, yaw in _places(world, left, rng, seating.piece):
            left, failed = smaller, 0
            seating.piece.shape.add_to(spec, f"{seating.piece.kind}{number}-seat", SEATS, on, yaw)
            for place in seating.places:
                x, y = turned(place[None, :2], yaw)[0] + on[:2]
                seats.append(np.array([x, y, on[2] + place[2], yaw + np.pi / 2]))
            break
        else:
            failed += 1
            if failed == CHAIR_TRIES:
                raise ValueError(f"{count} people shall sit, {len(seats)} seats fit into {world.name}")
        number += 1
    return replace(world, spec=spec, feet=left[0], wheels=left[1], seats=np.array(seats))


def _places(world: World, left: Spaces, rng: np.random.Generator, piece: Piece) -> Iterator[tuple[Spaces, Array, float]]:
    """Random places for a piece, at most TRIES of them: the remaining free space, position (3,) m and yaw rad."""
    free = left[0].points(left[0].free)
    for _ in range(TRIES):
        place, yaw = free[int(rng.integers(len(free)))], float(rng.uniform(-np.pi, np.pi))
        corners = piece.footprint(place, yaw)
        heights = world.terrain.height_at(np.concatenate([corners, [place]]))
        # Free corners keep wide pieces out of walls and out of each other.
        if not left[0].free_at(corners).all() or np.ptp(heights) > LEVEL or _near_spawn(world.spawn, corners):
            continue
        feet, wheels = (_without(space, corners, kind.half_width) for space, kind in zip(left, (FEET, WHEELS), strict=True))
        if feet is not None and wheels is not None:
            yield (feet, wheels), np.array([*place, float(heights.min()) - SINK]), yaw


def _near_spawn(spawn: Array, corners: Array) -> bool:
    low, high = corners.min(axis=0) - FEET.half_width - SPAWN_MARGIN, corners.max(axis=0) + FEET.half_width + SPAWN_MARGIN
    return bool(((spawn[:, 0] < high) & (spawn[:, 1] > low)).all(axis=1).any())


def _without(space: FreeSpace, corners: Array, half_width: float) -> FreeSpace | None:
    """Free space less a footprint and the walker's half width around it; None if less than LEAST_REMAINING would stay connected."""
    rows, columns = space.free.shape
    x, y = (space.origin[k] + space.spacing * np.arange(n) for k, n in ((0, columns), (1, rows)))
    taken = signed_distance(np.stack(np.meshgrid(x, y), axis=-1), corners) <= half_width + 0.5 * space.spacing
    left: Mask = space.free & ~taken
    joined = largest_region(left)
    if not joined.any() or joined.sum() < LEAST_REMAINING * left.sum():
        return None
    return FreeSpace(joined, space.origin, space.spacing)
