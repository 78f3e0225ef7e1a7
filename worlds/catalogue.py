"""All worlds by name, and `build`, which makes one.

The name of the world hall may have a plan behind it, as `hall:room=7.7x3.4`.
A file is a name, too (worlds.places), as `dem.png:size=60,low=0,high=6`.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from worlds.places.building import build_place
from worlds.places.place import is_place, place_of
from worlds.scenes import campus, forest, hall, hills, pilsun, quarry, ruins, tunnel
from worlds.world import World

Build = Callable[[np.random.Generator, float], World]

WORLDS: dict[str, Build] = {place.NAME: place.build for place in (campus, forest, hall, hills, pilsun, quarry, ruins, tunnel)}


def check_name(name: object, field: str = "world") -> None:
    """Raises ValueError, with the name of the field, for an unknown world or file, and for a plan that is wrong or not of hall."""
    if is_place(name):
        place_of(str(name), field)
        return
    base, colon, plan = name.partition(":") if isinstance(name, str) else ("", "", "")
    if base not in WORLDS:
        raise ValueError(f"{field} is {repr(name)[:60]}, needs one of {', '.join(sorted(WORLDS))}, or a file")
    if colon and base != hall.NAME:
        raise ValueError(f"{field} is {repr(name)[:60]}, but only {hall.NAME} takes a plan, as {hall.NAME}:room=7.7x3.4")
    if colon:
        hall.parse_plan(plan)


def build(name: str, rng: np.random.Generator, difficulty: float = 0.5) -> World:
    """The world of that name; difficulty in [0, 1] scales relief, steps and clutter. `hall` may have its plan behind a colon (hall.parse_plan).

    A file is as it is: difficulty has no effect on it.

    Raises ValueError for an unknown name, for a difficulty out of bounds, or where what the random numbers made cannot be walked in.
    """
    check_name(name)
    if not 0 <= difficulty <= 1:
        raise ValueError(f"difficulty is {difficulty}, needs 0 to 1")
    if is_place(name):
        return build_place(name, rng)
    base, colon, plan = name.partition(":")
    return hall.build(rng, difficulty, hall.parse_plan(plan)) if colon else WORLDS[base](rng, difficulty)
