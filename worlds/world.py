"""A ready world: the MuJoCo scene, its ground, the free space of feet and wheels, and the heights of what occludes people."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from worlds.engine import mujoco
from worlds.terrain.free_space import FreeSpace
from worlds.terrain.heightfield import Array, Heightfield
from worlds.terrain.walk_surface import Decks, Terrain


@dataclass(frozen=True, eq=False)
class PlaceCamera:
    """A camera of a user's MJCF: rotation (3, 3) and position (3,) m of T_world_camera, x forward, z up; view: vertical field of view, rad."""

    name: str
    rotation: Array
    position: Array
    view: float


@dataclass(frozen=True, eq=False)
class World:
    """A scene without actors.

    spec: not compiled; the simulation copies it and adds robots and people to its world body. ground: the terrain, the same surface as the geom
    "ground" of the spec. feet, wheels: free space of a walking person and of a small rover. spawn: (k, 2, 2) areas [[xmin, ymin], [xmax, ymax]] m
    where people enter. decks: what of meshes lies over the ground, to be walked on or under.
    seats: (k, 4) x, y and height m of places to sit, and the direction rad in which one looks there.
    place: of a user's file, the choices as the text of a place.toml, whose first lines say what was guessed or left out.
    cameras: those of a user's MJCF, which are fixed cameras.
    Raises ValueError where a spawn area is not free for feet, or where there is none.
    """

    name: str
    spec: mujoco.MjSpec
    ground: Heightfield
    feet: FreeSpace
    wheels: FreeSpace
    spawn: Array
    decks: Decks = field(default_factory=Decks)
    seats: Array = field(default_factory=lambda: np.zeros((0, 4)))
    place: str = ""
    cameras: tuple[PlaceCamera, ...] = ()

    @cached_property
    def terrain(self) -> Terrain:
        """What feet and wheels stand on: height_at and normal_at of it."""
        return Terrain(self.ground, self.decks)

    @property
    def notes(self) -> list[str]:
        """Lines for the user of what was read, guessed or left out of a file."""
        return notes_of(self.place)

    def tops(self) -> Heightfield:
        """A 2.5-D elevation map: the heights of the terrain and of what stands on it, on the grid of the ground, by rays from above.

        Whatever hangs higher than HEADROOM over the floor (beams, lintels, vaults) occludes nobody and is left out. A table is not left out.
        """
        model = self.spec.copy().compile()
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        nodes = self.ground.nodes.reshape(-1, 2)
        floors = self.terrain.height_at(nodes)
        heights = [_top(model, data, point, floor) for point, floor in zip(nodes.tolist(), floors.tolist(), strict=True)]
        return self.ground.with_heights(np.array(heights).reshape(self.ground.heights.shape))

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


def notes_of(place: str) -> list[str]:
    """The lines of a place.toml that say what was read, guessed or left out."""
    return [line.removeprefix("# ") for line in place.splitlines() if line.startswith("# ")]


def _grid(low: Array, high: Array, spacing: float) -> Array:
    """Places (n, 2) m over an area, its edges among them, not further apart than the spacing."""
    axes = [np.linspace(a, b, max(2, int(np.ceil((b - a) / spacing)) + 1)) for a, b in zip(low, high, strict=True)]
    return np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)


HEADROOM = 2.0
"""m over the floor. Whatever begins above this height occludes nobody."""

_FAR = 50.0


def _top(model: mujoco.MjModel, data: mujoco.MjData, point: list[float], floor: float) -> float:
    """Height in m of the highest object over a point (2,) m that reaches below HEADROOM; the height of the floor where there is none."""
    down, geom, z = np.array([0.0, 0.0, -1.0]), np.zeros(1, np.int32), floor + _FAR
    entered: dict[int, float] = {}
    while True:
        distance = mujoco.mj_ray(model, data, np.array([*point, z]), down, None, 1, -1, geom, None)
        surface = z - distance
        if distance < 0 or surface <= floor + 0.01:
            # Whatever was entered and not left goes into the ground.
            return max(entered.values(), default=floor)
        if int(geom[0]) not in entered:
            entered[int(geom[0])] = surface
        else:
            top = entered.pop(int(geom[0]))
            if surface < floor + HEADROOM:
                return max(top, *entered.values()) if entered else top
        z = surface - 1e-4
