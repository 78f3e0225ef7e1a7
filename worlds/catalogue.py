"""All worlds by name, and `build`, which makes one. The name of the world hall may have a plan behind it, as `hall:room=7.7x3.4`."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from worlds.scenes import campus, forest, hall, hills, pilsun, quarry, ruins, tunnel
from worlds.world import World

Build = Callable[[np.random.Generator, float], World]

WORLDS: dict[str, Build] = {place.NAME: place.build for place in (campus, forest, hall, hills, pilsun, quarry, ruins, tunnel)}


def check_name(name: object, field: str = "world") -> None:
    """Raises ValueError, with the name of the field, for an unknown world, and for a plan that is wrong or of another world than hall."""
    base, colon, plan = name.partition(":") if isinstance(name, str) else ("", "", "")
    if base not in WORLDS:
        raise ValueError(f"{field} is {repr(name)[:60]}, needs one of {', '.join(sorted(WORLDS))}")
    if colon and base != hall.NAME:
        raise ValueError(f"{field} is {repr(name)[:60]}, but only {hall.NAME} takes a plan, as {hall.NAME}:room=7.7x3.4")
    if colon:
        hall.parse_plan(plan)


def build(name: str, rng: np.random.Generator, difficulty: float = 0.5) -> World:
    """The world of that name; difficulty in [0, 1] scales relief, steps and clutter. `hall` may have its plan behind a colon (hall.parse_plan).

    Raises ValueError for an unknown name, for a difficulty out of bounds, or where what the random numbers made cannot be walked in.
    """
    check_name(name)
    if not 0 <= difficulty <= 1:
        raise ValueError(f"difficulty is {difficulty}, needs 0 to 1")
    base, colon, plan = name.partition(":")
    return hall.build(rng, difficulty, hall.parse_plan(plan)) if colon else WORLDS[base](rng, difficulty)
