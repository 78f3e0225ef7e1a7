"""All worlds by name, and `build`, which makes one."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from worlds.scenes import campus, forest, hills, pilsun, quarry, ruins, tunnel
from worlds.world import World

Build = Callable[[np.random.Generator, float], World]

WORLDS: dict[str, Build] = {place.NAME: place.build for place in (campus, forest, hills, pilsun, quarry, ruins, tunnel)}


def build(name: str, rng: np.random.Generator, difficulty: float = 0.5) -> World:
    """The world of that name; difficulty in [0, 1] scales relief, steps and clutter.

    Raises ValueError for an unknown name, for a difficulty out of bounds, or where what the random numbers made cannot be walked in.
    """
    if name not in WORLDS:
        raise ValueError(f"world is {name!r}, needs one of {', '.join(sorted(WORLDS))}")
    if not 0 <= difficulty <= 1:
        raise ValueError(f"difficulty is {difficulty}, needs 0 to 1")
    return WORLDS[name](rng, difficulty)
