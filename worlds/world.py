"""A complete world: the MuJoCo scene, its ground, the free space of feet and wheels, and the heights of objects that occlude people."""

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
    where people enter. decks: upward faces of meshes over the ground that people walk on or under.
    seats: (k, 4) x, y and height m of places to sit, and the direction rad in which the sitter faces.
    place: for a user's file, the text of its place.toml, whose first lines say what was read, guessed or left out; else empty.
    cameras: the fixed cameras of a user's MJCF.
    Raises ValueError if a spawn area is not free for feet, or if there is none.
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
        """The walkable surface of ground and decks, with height_at and normal_at."""
        return Terrain(self.ground, self.decks)

    @property
    def notes(self) -> list[str]:
        """Lines that tell the user what was read from a file, guessed, or left out."""
        return notes_of(self.place)

    def tops(self) -> Heightfield:
        """A 2.5-D elevation map: the heights of the terrain and of objects on it, on the grid of the ground, by rays from 50 m above the floor.

        Closed objects that begin above HEADROOM over the floor (beams, lintels, vaults) occlude nobody and are left out. A table is not left out.
        """
        model = self.spec.copy().compile()
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        nodes = self.ground.nodes.reshape(-1, 2)
        floors = self.terrain.height_at(nodes)
        highest = _highest(model, data, self.ground.extent)
        starts = [floor + _FAR if highest < floor + _FAR else highest + 1.0 for floor in floors.tolist()]
        sheets = bool(self.place)
        heights = [_top(model, data, *one, sheets) for one in zip(nodes.tolist(), floors.tolist(), starts, strict=True)]
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
    """The lines of the text of a place.toml that say what was read, guessed or left out."""
    return [line.removeprefix("# ") for line in place.splitlines() if line.startswith("# ")]


def _grid(low: Array, high: Array, spacing: float) -> Array:
    """Points (n, 2) m over an area, edges included, at most `spacing` m apart along each axis."""
    axes = [np.linspace(a, b, max(2, int(np.ceil((b - a) / spacing)) + 1)) for a, b in zip(low, high, strict=True)]
    return np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)


HEADROOM = 2.0
"""m over the floor. Objects that begin above this height occlude nobody."""

_FAR = 50.0
"""m over the floor: rays to tops begin there, or above what is taller."""


def _highest(model: mujoco.MjModel, data: mujoco.MjData, extent: Array) -> float:
    """z in m of the highest geom, height fields, planes and bodies that cover all of `extent` (2, 2) m, as a dome of sky does, left out."""
    turn, middle, half = data.geom_xmat.reshape(-1, 3, 3), model.geom_aabb[:, :3], model.geom_aabb[:, 3:]
    centre = data.geom_xpos + np.einsum("nij,nj->ni", turn, middle)
    reach = np.einsum("nij,nj->ni", np.abs(turn), half)
    covering = ((centre - reach)[:, :2] < extent[0]).all(axis=1) & ((centre + reach)[:, :2] > extent[1]).all(axis=1)
    covering &= model.geom_type != mujoco.mjtGeom.mjGEOM_MESH
    flat = np.isin(model.geom_type, [mujoco.mjtGeom.mjGEOM_PLANE, mujoco.mjtGeom.mjGEOM_HFIELD])
    return float(np.max((centre + reach)[~(flat | covering), 2], initial=-np.inf))


def _top(model: mujoco.MjModel, data: mujoco.MjData, point: list[float], floor: float, start: float, sheets: bool) -> float:
    """Height in m of the highest object over a point (2,) m that reaches below HEADROOM; the height of the floor if there is none.

    start: z in m where the ray begins. sheets: whether objects may be open, as the ceilings of a scan are.
    """
    down, geom, normal, z = np.array([0.0, 0.0, -1.0]), np.zeros(1, np.int32), np.zeros(3), start
    entered: dict[int, float] = {}
    while True:
        distance = mujoco.mj_ray(model, data, np.array([*point, z]), down, None, 1, -1, geom, normal)
        surface = z - distance
        if distance < 0 or surface <= floor + 0.01:
            # Objects that the ray has entered and not left reach into the ground.
            return max(entered.values(), default=floor)
        if int(geom[0]) in entered:
            top = entered.pop(int(geom[0]))
            if surface < floor + HEADROOM:
                return max(top, *entered.values()) if entered else top
        elif not sheets or normal[2] >= 0 or surface < floor + HEADROOM:
            # An open sheet above HEADROOM that faces down is a ceiling: the ray enters nothing there.
            entered[int(geom[0])] = surface
        z = surface - 1e-4
