"""Areas where people enter and leave a place: near its border, or where the user says."""

from __future__ import annotations

import numpy as np

from worlds.places.place import Place
from worlds.terrain.free_space import FreeSpace, spawn_areas
from worlds.terrain.heightfield import Array

SIDES = (1.2, 0.9, 0.6)
"""m: side lengths of an entrance; the largest that fits is used."""
MOST = 4
"""Largest number of entrances, unless the user names some."""


def entrances_of(place: Place, feet: FreeSpace, rng: np.random.Generator) -> Array:
    """Areas (k, 2, 2) m where people enter. Raises ValueError for an entrance that is not free, and if none fits in."""
    if place.entrances:
        return np.array([_square(place, feet, np.array(point)) for point in place.entrances])
    for side in SIDES:
        for count in range(MOST, 0, -1):
            try:
                return spawn_areas(feet, rng, count, side)
            except ValueError:
                continue
    raise ValueError(f"{place.source}: {feet.area:.1f} m² are free for people, but no entrance of {SIDES[-1]} m fits in")


def _square(place: Place, feet: FreeSpace, point: Array) -> Array:
    """The largest free square [[xmin, ymin], [xmax, ymax]] m around a point (2,) m. Raises ValueError if none is free."""
    for side in SIDES:
        if feet.clearance_at(point[None])[0] > side / np.sqrt(2):
            return np.array([point - side / 2, point + side / 2])
    free = feet.points(feet.clearance > SIDES[-1] / np.sqrt(2))
    near = free[int(np.argmin(np.hypot(*(free - point).T)))] if len(free) else None
    told = "" if near is None else f"; the nearest place for one is {near[0]:.2f}:{near[1]:.2f}"
    raise ValueError(f"{place.source}: entrance {point[0]:g}:{point[1]:g} is not free for people{told} (pilsim worlds … --preview DIR draws what is)")
