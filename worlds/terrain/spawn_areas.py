"""Spawn areas: small areas of free space where people enter and leave, far from each other and near its border."""

from __future__ import annotations

import numpy as np

from worlds.terrain.free_space import FreeSpace
from worlds.terrain.heightfield import Array


def spawn_areas(feet: FreeSpace, rng: np.random.Generator, count: int, side: float = 1.2) -> Array:
    """`count` squares of that side m as (count, 2, 2) [[xmin, ymin], [xmax, ymax]] m, all of them free.

    The first lies farthest out, each next one farthest from those before; the stream only breaks near ties, so that seeds differ.
    Raises ValueError where free space has no room for them.
    """
    i, j = np.nonzero(feet.clearance > side / np.sqrt(2) + feet.spacing)
    places = feet.origin + feet.spacing * np.stack([j, i], axis=1)
    if len(places) < count:
        raise ValueError(f"{count} spawn areas of {side} m are wanted, free space has room for {len(places)}")
    distance = np.hypot(*(places - places.mean(axis=0)).T) * rng.uniform(0.85, 1.0, len(places))
    chosen = [places[int(np.argmax(distance))]]
    nearest = np.full(len(places), np.inf)
    while len(chosen) < count:
        nearest = np.minimum(nearest, np.hypot(*(places - chosen[-1]).T))
        chosen.append(places[int(np.argmax(nearest * rng.uniform(0.85, 1.0, len(places))))])
    middles = np.array(chosen)[:, None]
    return np.concatenate([middles - side / 2, middles + side / 2], axis=1)
