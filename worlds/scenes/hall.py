"""A hall: a room, or a square in the open, of a given extent. At difficulty 0 it is flat and empty, so that given paths fit into it.

Difficulty adds pillars, furniture, low walls and uneven ground. Places that the plan keeps clear stay free of objects.
A text gives the extent, as in `--world hall:room=7.7x3.4`: room or square, then length x width in m around the origin, or X0:Y0:X1:Y1, its corners.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from scipy import ndimage

from worlds.engine import mujoco
from worlds.props import furniture
from worlds.props.furniture import Furnishing, Maker
from worlds.props.rooms import add_walls
from worlds.terrain.free_space import FreeSpace, spawn_areas, walkers_spaces
from worlds.terrain.heightfield import Array, Heightfield, Mask
from worlds.terrain.polygons import rectangle
from worlds.terrain.relief import swell
from worlds.textures.floors import floor
from worlds.textures.furniture_atlas import atlas
from worlds.textures.materials import Canvas, add_material, add_open_air
from worlds.textures.soils import Soil, soil
from worlds.world import World

NAME = "hall"
SPACING, SQUARE_SPACING = 0.125, 0.25
THICKNESS = 0.2
"""m: of the walls of a room."""
RIM = 2.0
"""m: the ground of a square reaches that far beyond it, and falls by SUNK at its edge, under the plain around it."""
SUNK, PLAIN = 0.4, 0.3
"""m: how far the edge falls, and how far the plain lies below the square."""
FAR = 250.0
"""m: of the plain around a square, from its middle."""
BODY = 0.6
"""m: objects are farther than this from places that are kept clear."""
TILED = 600.0
"""m²: larger floors have no tiles, whose texture would be too large."""
FREE_FOR_FEET, FREE_FOR_WHEELS = 0.4, 0.25
"""Least free shares of the floor."""
PAVING = Soil((150, 146, 140), (172, 168, 160), (128, 124, 118), 1.2, 6.0)
PILLAR_HEIGHT = 3.4
"""m: of pillars on a square."""

WALL_HEIGHT = 2.8
"""m: of a room without high cameras."""
LEAST_SIDE, LONGEST_ROOM, LONGEST_SQUARE = 3.0, 40.0, 150.0
"""m: bounds of the sides."""
_FORM = "room=LENGTHxWIDTH, square=LENGTHxWIDTH or room=X0:Y0:X1:Y1, in m"


@dataclass(frozen=True, eq=False)
class HallPlan:
    """The plan of a hall.

    extent (2, 2): lowest and highest x and y of the floor, m. walled: a room; otherwise a square. level: z of the floor at difficulty 0, m.
    wall_height: m above the level. kept_clear (n, 2): places of people that nothing may stand on, m.
    pillars (p, 5): upright cylinders that stand at every difficulty: x, y, radius, lowest and highest z in m.
    Raises ValueError for sides out of bounds.
    """

    extent: Array
    walled: bool = True
    level: float = 0.0
    wall_height: float = WALL_HEIGHT
    kept_clear: Array = field(default_factory=lambda: np.zeros((0, 2)))
    pillars: Array = field(default_factory=lambda: np.zeros((0, 5)))

    def __post_init__(self) -> None:
        extent = np.array(self.extent, dtype=np.float64)
        longest = LONGEST_ROOM if self.walled else LONGEST_SQUARE
        kind = "room" if self.walled else "square"
        sides = extent[1] - extent[0] if extent.shape == (2, 2) else np.full(2, np.nan)
        if not ((sides >= LEAST_SIDE) & (sides <= longest)).all() or not np.isfinite(extent).all():
            raise ValueError(f"{kind} of hall has sides of {sides[0]:g} and {sides[1]:g} m, needs {LEAST_SIDE:g} to {longest:g} m each")
        extent.flags.writeable = False
        object.__setattr__(self, "extent", extent)

    @property
    def sides(self) -> Array:
        """(2,) length along x and y, m."""
        return np.asarray(self.extent[1] - self.extent[0])

    @property
    def area(self) -> float:
        """m²."""
        return float(self.sides.prod())

    @property
    def outline(self) -> Array:
        """The corners (4, 2) m, anticlockwise."""
        (x0, y0), (x1, y1) = self.extent
        return np.array([(x0, y0), (x1, y0), (x1, y1), (x0, y1)])

    @property
    def text(self) -> str:
        """The plan as `parse_plan` reads it, without level, heights, clear places and pillars."""
        corners = ":".join(f"{value:.6g}" for value in self.extent.ravel().tolist())
        return f"{'room' if self.walled else 'square'}={corners}"


def parse_plan(text: str) -> HallPlan:
    """The plan of a text. Raises ValueError, which says what is needed."""
    kind, _, size = text.partition("=")
    numbers = [_number(word) for word in size.split("x" if "x" in size else ":")]
    if kind not in ("room", "square") or len(numbers) != (2 if "x" in size else 4) or not all(map(math.isfinite, numbers)):
        raise ValueError(f"world hall has the plan {text[:60]!r}, needs {_FORM}")
    corners = np.array(numbers)
    extent = np.array([-corners / 2, corners / 2]) if len(numbers) == 2 else corners.reshape(2, 2)
    return HallPlan(extent, kind == "room")


def _drawn(rng: np.random.Generator) -> HallPlan:
    """A room of 12 to 16 by 9 to 12 m around the origin."""
    sides = np.array([rng.uniform(12.0, 16.0), rng.uniform(9.0, 12.0)])
    return HallPlan(np.array([-sides / 2, sides / 2]))


def _number(word: str) -> float:
    try:
        return float(word)
    except ValueError:
        return math.nan


def build(rng: np.random.Generator, difficulty: float = 0.5, plan: HallPlan | None = None) -> World:
    """A hall by its plan, or a room of random size without one. Raises ValueError if people or rovers have too little free space."""
    plan = _drawn(rng) if plan is None else plan
    ground = _ground(rng, plan, difficulty)
    spec = mujoco.MjSpec()
    spec.modelname = NAME
    add_material(spec, "furniture", atlas(rng))
    add_material(spec, "ground", _floor(rng, plan, ground), 0.1)
    add_open_air(spec, rng, ground, ((0.58, 0.70, 0.85), (0.86, 0.89, 0.92)), 0.5)
    furnishing = Furnishing(ground, plan.outline)
    _enclose(spec, rng, plan)
    _given_pillars(spec, plan, furnishing)
    if len(plan.kept_clear):
        furnishing.clear |= _near(ground, plan.kept_clear, BODY)
    _furnish(spec, rng, plan, furnishing, difficulty)
    feet, wheels = walkers_spaces(NAME, ground, furnishing.blocked, (FREE_FOR_FEET * plan.area, FREE_FOR_WHEELS * plan.area))
    return World(NAME, spec, ground, feet, wheels, _entrances(feet, rng))


def _ground(rng: np.random.Generator, plan: HallPlan, difficulty: float) -> Heightfield:
    """Level at difficulty 0; otherwise uneven at wavelengths of 1.4 and 3.5 m, and in squares also of 16 m."""
    spacing, margin = (SPACING, 0.5) if plan.walled else (SQUARE_SPACING, RIM)
    low, high = plan.extent[0] - margin, plan.extent[1] + margin
    flat = Heightfield.flat([np.floor(low / spacing) * spacing, np.ceil(high / spacing) * spacing], spacing)
    nodes = flat.nodes
    uneven = difficulty * (swell(rng, nodes, 3.5, 0.07) + swell(rng, nodes, 1.4, 0.06))
    if plan.walled:
        return flat.with_heights(plan.level + uneven)
    # The square never sinks to the plain around it.
    uneven = np.maximum(uneven + difficulty * swell(rng, nodes, 16.0, 0.3), 0.1 - PLAIN)
    beyond = np.maximum(plan.extent[0] - nodes, nodes - plan.extent[1]).max(axis=2)
    rim = np.clip(1 - beyond / (RIM - 1.0), 0, 1)
    return flat.with_heights(plan.level + uneven * rim - SUNK * np.clip((beyond - RIM + 1.0) / 0.7, 0, 1))


def _floor(rng: np.random.Generator, plan: HallPlan, ground: Heightfield) -> Canvas:
    return floor(rng, ground) if plan.walled and plan.area <= TILED else soil(rng, ground, PAVING)


def _enclose(spec: mujoco.MjSpec, rng: np.random.Generator, plan: HallPlan) -> None:
    """The walls of a room, two of them with doors; around a square a plain without end or feature."""
    if plan.walled:
        before = {geom.name for geom in spec.geoms}
        add_walls(spec, rng, plan.outline, (1, 3), (THICKNESS, plan.wall_height))
        for geom in spec.geoms:
            if geom.name not in before:
                geom.pos = [*geom.pos[:2], geom.pos[2] + plan.level]
        return
    middle = plan.extent.mean(axis=0)
    size, position = [FAR, FAR, 0.5], [*middle, plan.level - PLAIN - 0.5]
    far = spec.worldbody.add_geom(name="ground1", type=mujoco.mjtGeom.mjGEOM_BOX, size=size, pos=position)
    far.rgba, far.contype, far.conaffinity, far.castshadow = (0.55, 0.54, 0.52, 1.0), 0, 0, False


def _given_pillars(spec: mujoco.MjSpec, plan: HallPlan, furnishing: Furnishing) -> None:
    for k, (x, y, radius, low, high) in enumerate(plan.pillars.tolist()):
        size, position = [radius, (high - low) / 2, 0], [x, y, (low + high) / 2]
        geom = spec.worldbody.add_geom(name=f"pillar{1000 + k}", type=mujoco.mjtGeom.mjGEOM_CYLINDER, size=size, pos=position, group=1)
        geom.rgba = (0.62, 0.61, 0.58, 1.0)
        furnishing.take(rectangle([x, y], [2 * radius, 2 * radius]))


def _furnish(spec: mujoco.MjSpec, rng: np.random.Generator, plan: HallPlan, furnishing: Furnishing, difficulty: float) -> None:
    """Pillars first, then pieces along walls, then free-standing pieces; pieces without a place are left out."""
    amount = difficulty * (plan.area / 100) ** 0.75
    edges = np.stack([plan.outline, np.roll(plan.outline, -1, axis=0)], axis=1)
    tall = plan.wall_height if plan.walled else PILLAR_HEIGHT
    pillars: list[Maker] = [lambda r: furniture.pillar(r, tall)] * round(3 * amount)
    along: list[Maker] = [furniture.shelf, furniture.cabinet, furniture.table] * round(3 * amount) if plan.walled else []
    indoors: list[Maker] = [furniture.table, furniture.crates, furniture.barrel]
    outdoors: list[Maker] = [furniture.low_wall, furniture.bench, furniture.crates]
    about = (indoors if plan.walled else outdoors) * round(2 * amount)
    for number, (piece, place) in enumerate(furnishing.places(rng, ((pillars, False), (along, True), (about, False)), edges)):
        furnishing.put(spec, f"{piece.kind}{number}", piece, place)


def _near(ground: Heightfield, places: Array, radius: float) -> Mask:
    """Mask (rows, columns) of grid points at most `radius` m from one of the places (n, 2) m."""
    rows, columns = ground.heights.shape
    j, i = np.rint((places - ground.origin) / ground.spacing).astype(np.int64).T
    inside = (i >= 0) & (j >= 0) & (i < rows) & (j < columns)
    far = np.ones((rows, columns), dtype=bool)
    far[i[inside], j[inside]] = False
    return np.asarray(ndimage.distance_transform_edt(far) * ground.spacing <= radius + ground.spacing, dtype=np.bool_)


def _entrances(feet: FreeSpace, rng: np.random.Generator) -> Array:
    """Four spawn areas, small ones in small rooms. Raises ValueError if there is no room for them."""
    deepest = float(feet.clearance.max()) - feet.spacing
    return spawn_areas(feet, rng, 4, float(np.clip(1.2 * deepest, 0.3, 1.2)))
