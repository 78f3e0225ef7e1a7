"""All worlds by name, and `build`, which makes one.

A plan may follow the name of the world hall, as in `hall:room=7.7x3.4`.
The path of a file is also a name (worlds.places), as in `dem.png:size=60,low=0,high=6`.
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
    """Raises ValueError, with the name of the field, for an unknown world or file, a wrong plan, or a plan without hall."""
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
    """The world of that name; difficulty in [0, 1] scales relief, steps and clutter. A plan of `hall` follows a colon (hall.parse_plan).

    Difficulty has no effect on a file.

    Raises ValueError for an unknown name, for a difficulty out of bounds, or if the random world has too little free space.
    """
    check_name(name)
    if not 0 <= difficulty <= 1:
        raise ValueError(f"difficulty is {difficulty}, needs 0 to 1")
    if is_place(name):
        return build_place(name, rng)
    base, colon, plan = name.partition(":")
    return hall.build(rng, difficulty, hall.parse_plan(plan)) if colon else WORLDS[base](rng, difficulty)
