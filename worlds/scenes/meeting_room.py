"""Rooms in which people sit: meetings around a table, offices, canteens, bars, and rows of chairs before a screen.

Windows saturate all cameras, screens show people, and coats hang over chairs. The floor is level.
These rooms only train the detector of people. Most are too narrow for rovers, so that they are not in the catalogue.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from worlds.engine import mujoco
from worlds.props import distractors, furniture
from worlds.props.rooms import add_walls
from worlds.props.shapes import Shape, box, column, joined, quad
from worlds.props.table_things import coat_over_back, laid, loudspeaker, office_chair
from worlds.terrain.free_space import spawn_areas, walkers_spaces
from worlds.terrain.heightfield import Array, Heightfield, Mask
from worlds.terrain.polygons import covered, rectangle, signed_distance, turned
from worlds.textures.floors import floor
from worlds.textures.furniture_atlas import Surface, atlas
from worlds.textures.materials import add_light, add_material, add_sky, set_view
from worlds.textures.person_pictures import COUNT, pictures, texture_of
from worlds.world import World

NAME = "meeting_room"
SPACING, MARGIN, THICKNESS = 0.125, 0.5, 0.2
SIDES = (4.5, 11.0), (4.0, 8.0)
"""m: bounds of length and width."""
WAY = 1.3
"""m: least distance between walls and tables."""
LEAST_FREE = 1.5, 0.5
"""m²: least free area of feet and of wheels."""
KINDS = {"meeting": 0.5, "office": 0.15, "canteen": 0.12, "bar": 0.08, "rows": 0.15}
"""Kind of room → its probability."""
COAT_SHARE, EMPTY_SHARE = 0.25, 0.12
"""Shares of the chairs with a coat over the back, and of those that stay empty."""
DAYLIGHT = ((1.0, 1.0, 1.0), (0.93, 0.96, 1.0), (0.75, 0.83, 0.9), (0.6, 0.66, 0.6))
"""Colours of what windows show."""


@dataclass(eq=False)
class _Table:
    """A table with seats, or a row of seats alone. size (length, width) and height m, yaw rad; reach: m from edge to seats; seat: their height m."""

    place: Array
    size: tuple[float, float]
    height: float = 0.74
    yaw: float = 0.0
    round: bool = False
    sides: str = "lr"
    reach: float = 0.2
    seat: float = 0.47
    apart: float = 0.75
    screens: bool = False

    def seats(self) -> Array:
        """Seats (k, 3) in the frame of the room: x, y m and the direction rad in which the sitter faces."""
        length, width = self.size
        count = max(1, int((length - 0.1) / self.apart))
        along = self.apart * (np.arange(count) - (count - 1) / 2)
        out = []
        if self.round:
            angle = 2 * np.pi * np.arange(n := max(3, int(np.pi * length / self.apart))) / n
            radius = length / 2 + self.reach
            out = [np.column_stack([radius * np.cos(angle), radius * np.sin(angle), angle + np.pi])]
        else:
            for side, turn in (("l", 1.0), ("r", -1.0)):
                if side in self.sides:
                    out.append(np.column_stack([along, np.full(count, turn * (width / 2 + self.reach)), np.full(count, -turn * np.pi / 2)]))
            if "e" in self.sides:
                out.append(np.array([[sign * (length / 2 + self.reach), 0.0, np.pi * (sign > 0)] for sign in (-1.0, 1.0)]))
        places = np.concatenate(out)
        return np.column_stack([turned(places[:, :2], self.yaw) + self.place, places[:, 2] + self.yaw])


@dataclass(eq=False)
class _Room:
    """A room under construction. sides (2,) m. shapes: furniture. seats: x, y, height m, direction rad. taken: mask of blocked grid points."""

    rng: np.random.Generator
    sides: Array
    height: float
    ground: Heightfield
    taken: Mask
    shapes: list[Shape] = field(default_factory=list)
    seats: list[Array] = field(default_factory=list)

    def add(self, shape: Shape, corners: Array | None = None) -> None:
        """Furniture, and the polygon (k, 2) m that it blocks."""
        self.shapes.append(shape)
        if corners is not None:
            self.taken |= covered(self.ground, corners, SPACING / 2)


def build(rng: np.random.Generator) -> World:
    """A room with furniture and seats. Raises ValueError if people or rovers have too little free space."""
    sides = np.array([rng.uniform(*bounds) for bounds in SIDES])
    outline = rectangle((0, 0), sides)
    half = np.ceil((sides / 2 + MARGIN) / SPACING) * SPACING
    ground = Heightfield.flat([-half, half], SPACING)
    room = _Room(rng, sides, rng.uniform(2.5, 3.3), ground, signed_distance(ground.nodes, outline) > -SPACING / 2)
    spec = mujoco.MjSpec()
    spec.modelname = NAME
    add_material(spec, "furniture", atlas(rng))
    add_material(spec, "ground", floor(rng, ground), 0.1)
    ground.add_to(spec, "ground", "ground").castshadow = False
    add_sky(spec, (0.58, 0.70, 0.85), (0.86, 0.89, 0.92))
    add_light(spec, [*turned([0.5, 0.0], rng.uniform(-np.pi, np.pi)), -1.0], rng.uniform(0.7, 1.1))
    set_view(spec, ground.extent)
    add_walls(spec, rng, outline, (int(rng.integers(4)),), (THICKNESS, room.height))
    _light_surfaces(spec, room)
    _screens(spec, room)
    tables = _LAYOUTS[str(rng.choice(list(KINDS), p=list(KINDS.values())))](room)
    for table in tables:
        _furnish(room, table)
    _along_walls(room)
    geom = joined(room.shapes).add_to(spec, "furniture", "furniture")
    # Its convex hull would fill the room.
    geom.contype = geom.conaffinity = 0
    feet, wheels = walkers_spaces(NAME, ground, room.taken, LEAST_FREE)
    deepest = float(feet.clearance.max()) - feet.spacing
    return World(NAME, spec, ground, feet, wheels, spawn_areas(feet, rng, 1, float(np.clip(1.2 * deepest, 0.15, 0.8))), seats=np.array(room.seats))


def _meeting(room: _Room) -> list[_Table]:
    """One long or round table, people on all sides of it."""
    rng, most = room.rng, room.sides - 2 * WAY
    reach, apart, height = rng.uniform(0.05, 0.4), rng.uniform(0.58, 0.85), rng.uniform(0.7, 0.78)
    if rng.random() < 0.2:
        return [_Table(np.zeros(2), (min(rng.uniform(1.0, 2.2), most.min()),) * 2, height, round=True, reach=reach, apart=apart)]
    size = min(rng.uniform(1.6, 6.5), most[0]), min(rng.uniform(0.8, 1.8), most[1])
    return [_Table(rng.normal(0.0, 0.15, 2), size, height, rng.normal(0.0, 0.05), sides="lre"[: int(rng.integers(2, 4))], reach=reach, apart=apart)]


def _grid(room: _Room, size: tuple[float, float], gaps: tuple[float, float]) -> list[Array]:
    """Places (2,) m of as many tables of a size as the room holds with gaps between them."""
    step = np.array(size) + gaps
    count = np.maximum(((room.sides - 1.2 + gaps) / step).astype(int), 1)
    return [step * (np.array([i, j]) - (count - 1) / 2) for i in range(count[0]) for j in range(count[1])]


def _office(room: _Room) -> list[_Table]:
    """Desks with screens, one seat each, in pairs that face each other."""
    rng, size = room.rng, (1.5, 0.75)
    out = []
    for place in _grid(room, (size[0], 2 * size[1]), (rng.uniform(0.0, 0.8), rng.uniform(1.5, 2.2))):
        for sign, side in ((1.0, "l"), (-1.0, "r")):
            reach, screens = rng.uniform(0.05, 0.35), rng.random() < 0.8
            out.append(_Table(place + np.array([0.0, sign * size[1] / 2]), size, sides=side, reach=reach, apart=1.4, screens=screens))
    return out


def _canteen(room: _Room) -> list[_Table]:
    """Small tables."""
    rng, size = room.rng, (room.rng.uniform(0.8, 1.7), room.rng.uniform(0.7, 0.9))
    places = _grid(room, size, (rng.uniform(0.6, 1.6), rng.uniform(1.2, 1.8)))
    return [_Table(place, size, yaw=rng.normal(0.0, 0.1), apart=0.65, reach=rng.uniform(0.05, 0.3)) for place in places]


def _bar(room: _Room) -> list[_Table]:
    """A counter with stools in front; people stand behind it."""
    rng, length = room.rng, min(room.rng.uniform(2.0, 5.0), room.sides[0] - 1.6)
    place = np.array([rng.uniform(-0.3, 0.3), room.sides[1] / 2 - rng.uniform(1.3, 2.0)])
    return [_Table(place, (length, 0.6), rng.uniform(1.0, 1.2), sides="r", reach=0.15, seat=rng.uniform(0.66, 0.78), apart=0.7)]


def _rows(room: _Room) -> list[_Table]:
    """Rows of chairs, one behind the other, without tables."""
    rng, length = room.rng, room.sides[0] - float(room.rng.uniform(1.2, 2.4))
    apart, depth = rng.uniform(0.55, 0.7), rng.uniform(0.8, 1.1)
    rows = int((room.sides[1] - 2.0) / depth)
    first = room.sides[1] / 2 - 0.7
    return [_Table(np.array([0.0, first - depth * k]), (length, 0.0), 0.0, sides="l", reach=0.0, apart=apart) for k in range(rows)]


_LAYOUTS = {"meeting": _meeting, "office": _office, "canteen": _canteen, "bar": _bar, "rows": _rows}


def _furnish(room: _Room, table: _Table) -> None:
    """The table, its chairs, and the objects on it."""
    rng = room.rng
    if table.height:
        room.add(_slab(rng, table), rectangle(table.place, table.size, table.yaw))
        for _ in range(int(rng.integers(0, 3))):
            offset = turned(rng.uniform(-0.3, 0.3, 2) * table.size, table.yaw) + table.place
            room.add(loudspeaker(rng).turned(0.0, (*offset, table.height)))
    own = rng.random() < 0.5
    for x, y, look in table.seats():
        place = np.array([x, y]) + rng.normal(0.0, 0.05, 2)
        yaw = look + rng.normal(0.0, 0.2)
        if (np.abs(place) > room.sides / 2 - 0.35).any():
            continue
        chair = office_chair(rng, table.seat) if own or table.seat > 0.5 else furniture.chair(rng).shape
        if rng.random() < COAT_SHARE:
            chair += coat_over_back(rng, table.seat)
        room.add(chair.turned(yaw - np.pi / 2, (*place, 0.0)), rectangle(place, (0.45, 0.45), yaw))
        if rng.random() > EMPTY_SHARE:
            room.seats.append(np.array([*place, table.seat, yaw]))
        things = laid(rng, table.screens) if table.height else None
        if things is not None:
            edge = np.array([x, y]) + table.reach * np.array([np.cos(look), np.sin(look)])
            room.add(things.turned(look - np.pi / 2, (*edge, table.height)))


def _slab(rng: np.random.Generator, table: _Table) -> Shape:
    """The table: a top on legs, on a foot, or closed to the floor."""
    wood = (Surface.OAK, Surface.WALNUT, Surface.WHITE, Surface.DARK)[int(rng.integers(4))]
    (length, width), h = table.size, table.height
    if table.round:
        shape = column(rng, wood, length / 2, 0.04).moved((0, 0, h - 0.04)) + column(rng, Surface.DARK, 0.12, h - 0.04)
    else:
        shape = box(rng, wood, (-length / 2, -width / 2, h - 0.04), (length / 2, width / 2, h))
        closed = h > 0.9 or rng.random() < 0.25
        inset = (0.0, 0.05) if closed else (0.35 * width, 0.3 * length)
        low, high = (-length / 2 + inset[1], -width / 2 + inset[0] + 0.02), (length / 2 - inset[1], width / 2 - inset[0] - 0.02)
        if closed or rng.random() < 0.4:
            shape += box(rng, wood, (*low, 0.0), (*high, h - 0.04))
        else:
            for x in (-length / 2 + 0.05, length / 2 - 0.1):
                for y in (-width / 2 + 0.05, width / 2 - 0.1):
                    shape += box(rng, Surface.DARK, (x, y, 0), (x + 0.05, y + 0.05, h - 0.04))
    return shape.turned(table.yaw, (*table.place, 0.0))


def _along_walls(room: _Room) -> None:
    """Cabinets, shelves, coat stands, heaps of clothes and tripods at the walls, where there is room."""
    rng = room.rng
    makers = (furniture.cabinet, furniture.shelf, distractors.coat_stand, distractors.clothes_heap, furniture.crates, distractors.tripod)
    for _ in range(int(rng.integers(1, 8))):
        piece = makers[int(rng.integers(len(makers)))](rng)
        side, (width, depth) = int(rng.integers(4)), piece.size
        along, half = (room.sides[0], room.sides[1] / 2) if side % 2 == 0 else (room.sides[1], room.sides[0] / 2)
        place = turned(np.array([rng.uniform(-0.5, 0.5) * (along - width - 0.2), half - depth / 2 - 0.05]), side * np.pi / 2)
        corners = piece.footprint(place, side * np.pi / 2)
        if not (room.taken & covered(room.ground, corners, 0.1) & (signed_distance(room.ground.nodes, rectangle((0, 0), room.sides)) < -0.1)).any():
            room.add(piece.shape.turned(side * np.pi / 2, (*place, 0.0)), corners)


def _light_surfaces(spec: mujoco.MjSpec, room: _Room) -> None:
    """A ceiling with lamps, and windows with frames that saturate all cameras."""
    rng, (length, width) = room.rng, room.sides
    shade = rng.uniform(0.35, 0.75)
    ceiling = np.array([0.0, 0.0, room.height + 0.05]), np.array([length / 2 + 0.2, width / 2 + 0.2, 0.05])
    _panel(spec, "ceiling", ceiling, (shade, shade, shade), 0.05)
    lamp, number = rng.uniform(0.15, 0.7, 2), 0
    for x in np.arange(-length / 2 + 1.0, length / 2 - 0.5, rng.uniform(1.4, 3.0)):
        for y in np.arange(-width / 2 + 1.0, width / 2 - 0.5, rng.uniform(1.4, 3.0)):
            _panel(spec, f"lamp{number}", (np.array([x, y, room.height]), np.array([*lamp, 0.02])), (1.0, 1.0, 0.97), 1.0)
            number += 1
    for side in np.flatnonzero(rng.random(4) < 0.45).tolist():
        along, half = (length, width / 2) if side % 2 == 0 else (width, length / 2)
        sill, wide, colour = rng.uniform(0.2, 1.1), rng.uniform(0.8, 2.2), DAYLIGHT[int(rng.integers(len(DAYLIGHT)))]
        tall = room.height - sill - rng.uniform(0.1, 0.6)
        for x in np.arange(-along / 2 + 0.2 + wide / 2, along / 2 - wide / 2, wide + rng.uniform(0.1, 0.8)):
            middle, turn = turned(np.array([x, half - 0.02]), side * np.pi / 2), side % 2
            size = np.array([0.02, wide / 2, tall / 2]) if turn else np.array([wide / 2, 0.02, tall / 2])
            _panel(spec, f"window{number}", (np.array([*middle, sill + tall / 2]), size), colour, 1.0)
            post = box(rng, Surface.STEEL, (-0.03, -0.03, sill), (0.03, 0.0, sill + tall))
            room.add(post.turned(side * np.pi / 2, (*middle, 0.0)))
            number += 1


def _panel(spec: mujoco.MjSpec, name: str, at: tuple[Array, Array], colour: tuple[float, float, float], emission: float) -> None:
    """An emissive box. at: its middle and its half sizes (3,) m."""
    material = spec.add_material(name=name, emission=emission, specular=0.0)
    material.rgba = [*colour, 1.0]
    geom = spec.worldbody.add_geom(name=name, type=mujoco.mjtGeom.mjGEOM_BOX, pos=at[0], size=at[1], material=name, group=1)
    geom.contype, geom.conaffinity, geom.castshadow = 0, 0, False


def _screens(spec: mujoco.MjSpec, room: _Room) -> None:
    """Screens on the walls that show people from the hips upwards, larger or smaller than life."""
    rng = room.rng
    add_material(spec, "screens", pictures(rng))
    spec.material("screens").emission = rng.uniform(0.2, 0.8)
    for number in range(int(rng.integers(0, 4))):
        side, scale, base = int(rng.integers(4)), rng.uniform(0.4, 1.3), rng.uniform(0.8, 1.4)
        along, half = (room.sides[0], room.sides[1] / 2) if side % 2 == 0 else (room.sides[1], room.sides[0] / 2)
        tiles, count = list[Shape](), int(rng.integers(1, 4))
        for k in range(count):
            part = np.array([[-0.45, 0.8], [0.45, 0.8], [0.45, 1.8], [-0.45, 1.8]])
            picture = texture_of(int(rng.integers(COUNT)), part)[[3, 1]]
            x = scale * 0.9 * (k - count / 2)
            end = x + 0.9 * scale
            tiles.append(quad([(x, 0, 0), (end, 0, 0), (end, 0, scale), (x, 0, scale)], picture))
            # A mesh needs a volume.
            tiles.append(quad([(x, 0.01, 0), (x, 0.01, scale), (end, 0.01, scale), (end, 0.01, 0)], picture))
        place = turned(np.array([rng.uniform(-0.3, 0.3) * along, half - 0.07]), side * np.pi / 2)
        wide = 0.45 * scale * count + 0.04
        case = box(rng, Surface.DARK, (-wide, 0.005, base - 0.04), (wide, 0.06, base + scale + 0.04))
        room.add(case.turned(side * np.pi / 2, (*place, 0.0)))
        joined(tiles).turned(side * np.pi / 2, (*place, base)).add_to(spec, f"screen{number}", "screens").contype = 0
