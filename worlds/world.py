"""A ready place: the scene, its ground, and where feet and wheels may go."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import mujoco
import numpy as np

from worlds.heightfield import Array, Heightfield
from worlds.terrain import Decks, Terrain
from worlds.walkable import Walkable


@dataclass(frozen=True, eq=False)
class World:
    """A scene without actors.

    spec: not compiled; the simulation copies it and adds robots and people to its world body. ground: the terrain, the same surface as the geom
    "ground" of the spec. feet, wheels: free space of a walking person and of a small rover. spawn: (k, 2, 2) areas [[xmin, ymin], [xmax, ymax]] m
    where people enter. decks: what of meshes lies over the ground, to be walked on or under.
    Raises ValueError where a spawn area is not free for feet, or where there is none.
    """

    name: str
    spec: mujoco.MjSpec
    ground: Heightfield
    feet: Walkable
    wheels: Walkable
    spawn: Array
    decks: Decks = field(default_factory=Decks)

    @cached_property
    def terrain(self) -> Terrain:
        """What feet and wheels stand on: height_at and normal_at of it."""
        return Terrain(self.ground, self.decks)

    def __post_init__(self) -> None:
        spawn = np.array(self.spawn, dtype=np.float64)
        if spawn.ndim != 3 or spawn.shape[1:] != (2, 2) or not len(spawn):
            raise ValueError(f"spawn areas of {self.name} have shape {spawn.shape}, need (k, 2, 2) with k of at least 1")
        spawn.flags.writeable = False
        object.__setattr__(self, "spawn", spawn)
        for low, high in spawn:
            blocked = int((~self.feet.free_at(_grid(low, high, self.feet.spacing))).sum())
            if blocked:
                raise ValueError(f"{blocked} places of the spawn area {low} to {high} m of {self.name} are not free for feet, need 0")


def _grid(low: Array, high: Array, spacing: float) -> Array:
    """Places (n, 2) m over an area, its edges among them, not further apart than the spacing."""
    axes = [np.linspace(a, b, max(2, int(np.ceil((b - a) / spacing)) + 1)) for a, b in zip(low, high, strict=True)]
    return np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)
