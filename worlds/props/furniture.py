"""Furniture and other things that stand on the ground, and their layout: along walls or free on the floor, without blocking a passage.

A piece stands around its own origin, its front looks along −y and its back is at +y. Seats for people look along +y of their piece.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import ArrayLike
from scipy import ndimage

from worlds.engine import mujoco
from worlds.props.shapes import Shape, box, column, joined
from worlds.terrain.heightfield import Array, Heightfield, Mask
from worlds.terrain.polygons import covered, rectangle, signed_distance, turned
from worlds.textures.furniture_atlas import Surface

# Gap on all sides of free-standing pieces and in front of pieces at walls, m: one rover fits through, two do not.
GAP = 1.1
# Largest height range of the ground under a piece, m.
LEVEL = 0.07
TRIES = 60

Place = tuple[Array, float]
COLOURS = (Surface.BLUE, Surface.RED, Surface.GREEN, Surface.YELLOW, Surface.DARK)
# Pieces sink this far below the lowest ground under them, m, so that their feet never hover.
SINK = 0.02
# Thickness of the painted foot of a pillar, m: enough for a depth buffer to tell it from the pillar.
PAINT = 0.012


@final
class Furnishing:
    """Masks (rows, columns) on the grid of the ground: walls, furniture so far, and places that are kept clear."""

    def __init__(self, ground: Heightfield, outline: Array) -> None:
        """outline: corners (k, 2) m of the room; outside of it and within half a cell of its edge is wall."""
        self.ground = ground
        self.nodes = ground.nodes
        self.walls: Mask = signed_distance(self.nodes, outline) > -ground.spacing / 2
        self.furniture: Mask = np.zeros_like(self.walls)
        self.clear: Mask = np.zeros_like(self.walls)

    @property
    def blocked(self) -> Mask:
        return self.walls | self.furniture

    def take(self, corners: ArrayLike) -> None:
        """Mark a polygon (k, 2) m as occupied."""
        self.furniture |= self._under(corners)

    def keep_clear(self, corners: ArrayLike, margin: float = 0.0) -> None:
        """Keep a polygon (k, 2) m and a margin m around it clear of furniture."""
        self.clear |= covered(self.ground, corners, margin)

    def at_wall(self, rng: np.random.Generator, piece: Piece, edges: ArrayLike) -> Place | None:
        """A place with its back to one of the walls, edges (k, 2, 2) m with the room on their left; None if none was found."""
        walls = np.asarray(edges, dtype=np.float64)
        lengths = np.hypot(*(walls[:, 1] - walls[:, 0]).T)
        width, depth = piece.size
        for _ in range(TRIES):
            k = int(rng.choice(len(walls), p=lengths / lengths.sum()))
            ahead = (walls[k, 1] - walls[k, 0]) / lengths[k]
            inwards = np.array([-ahead[1], ahead[0]])
            yaw = float(np.arctan2(inwards[0], -inwards[1]))
            reach = max(lengths[k] - width - 0.1, 0.0)
            position = walls[k, 0] + ahead * (0.05 + width / 2 + rng.uniform(0, reach)) + inwards * (depth / 2 + 0.03)
            under = self._under(piece.footprint(position, yaw))
            before = self._under(rectangle(position + inwards * (depth + GAP) / 2, (width, GAP), yaw))
            fits = reach > 0 and not ((self.furniture | self.clear)[under].any() or (self.blocked & ~under)[before].any())
            if fits and self._level(under):
                return position, yaw
        return None

    def standing_free(self, rng: np.random.Generator, piece: Piece) -> Place | None:
        """A place with GAP on all sides and a random yaw; None if none was found."""
        room = ndimage.distance_transform_edt(~self.blocked) * self.ground.spacing
        candidates = np.argwhere((room > GAP) & ~self.clear)
        for _ in range(TRIES if len(candidates) else 0):
            i, j = candidates[int(rng.integers(len(candidates)))]
            yaw = float(rng.uniform(-np.pi, np.pi))
            under = self._under(piece.footprint(self.nodes[i, j], yaw))
            if room[under].min() > GAP and not self.clear[under].any() and self._level(under):
                return self.nodes[i, j], yaw
        return None

    def places(self, rng: np.random.Generator, makers: Iterable[tuple[Iterable[Maker], bool]], edges: ArrayLike) -> Iterator[tuple[Piece, Place]]:
        """New pieces and their places, one after the other, for `put`; pieces without a place are left out.

        makers: groups of functions, each with whether its pieces stand at a wall. edges: as in at_wall.
        """
        for kinds, at_wall in makers:
            for make in kinds:
                piece = make(rng)
                place = self.at_wall(rng, piece, edges) if at_wall else self.standing_free(rng, piece)
                if place is not None:
                    yield piece, place

    def put(self, spec: mujoco.MjSpec, name: str, piece: Piece, place: Place) -> None:
        """Put a piece in its place, as a geom of that name."""
        piece.stand(spec, self.ground, name, *place)
        self.take(piece.footprint(*place))

    def _under(self, corners: ArrayLike) -> Mask:
        return covered(self.ground, corners, self.ground.spacing / 2)

    def _level(self, under: Mask) -> bool:
        heights = self.ground.heights[under]
        return bool(heights.size) and float(np.ptp(heights)) < LEVEL


@dataclass(frozen=True, eq=False)
class Piece:
    """An object: its kind, its mesh, and size (width, depth) m of the rectangle that it stands on.

    picture: a second mesh, with pictures of people (worlds.textures.person_pictures); None for most things.
    """

    kind: str
    shape: Shape
    size: tuple[float, float]
    picture: Shape | None = None

    def footprint(self, position: ArrayLike, yaw: float) -> Array:
        """Corners (4, 2) m of the rectangle when it stands at position (2,) m turned by yaw radians."""
        return rectangle(position, self.size, yaw)

    def stand(self, spec: mujoco.MjSpec, ground: Heightfield, name: str, position: ArrayLike, yaw: float) -> mujoco.MjsGeom:
        """Put it on the ground at position (2,) m, turned by yaw radians, as a geom of that name made of the material "furniture"."""
        x, y = np.asarray(position, dtype=np.float64)
        offsets = np.array([(a, b) for a in np.linspace(-0.5, 0.5, 7) for b in np.linspace(-0.5, 0.5, 7)])
        under = turned(offsets * np.array(self.size), yaw) + np.array([x, y])
        return self.shape.add_to(spec, name, "furniture", [x, y, float(ground.height_at(under).min()) - SINK], yaw)


Maker = Callable[[np.random.Generator], Piece]


def table(rng: np.random.Generator) -> Piece:
    """A work table with things on it."""
    w, d, h = rng.uniform(1.2, 1.8), rng.uniform(0.65, 0.85), rng.uniform(0.72, 0.8)
    wood = (Surface.OAK, Surface.WALNUT, Surface.WHITE)[int(rng.integers(3))]
    shape = box(rng, wood, (-w / 2, -d / 2, h - 0.04), (w / 2, d / 2, h))
    for x in (-w / 2 + 0.03, w / 2 - 0.08):
        for y in (-d / 2 + 0.03, d / 2 - 0.08):
            shape += box(rng, Surface.DARK, (x, y, 0), (x + 0.05, y + 0.05, h - 0.04))
    shape += box(rng, wood, (-w / 2 + 0.08, d / 2 - 0.06, 0.3), (w / 2 - 0.08, d / 2 - 0.04, h - 0.04))
    return Piece("table", _laden(rng, shape, (-w / 2 + 0.05, w / 2 - 0.05), d, h), (w, d))


def _laden(rng: np.random.Generator, shape: Shape, across: tuple[float, float], depth: float, top: float) -> Shape:
    """The shape with screens, boxes and instruments side by side on its top."""
    x = across[0]
    while x < across[1] - 0.2:
        w = min(rng.uniform(0.18, 0.5), across[1] - x)
        kind = rng.uniform()
        if kind < 0.35:
            y = rng.uniform(0.05, min(0.2, depth / 2 - 0.03))
            shape += box(rng, Surface.DARK, (x + 0.4 * w, y - 0.02, top), (x + 0.6 * w, y + 0.02, top + 0.15))
            shape += box(rng, Surface.DARK, (x, y - 0.06, top + 0.12), (x + w, y - 0.02, top + 0.14 + 0.62 * w), front=Surface.SCREEN)
        elif kind < 0.8:
            d, h = rng.uniform(0.12, 0.3), rng.uniform(0.06, 0.3)
            y = rng.uniform(-depth / 2 + 0.04, depth / 2 - d - 0.02)
            surface = (*COLOURS, Surface.LABELS, Surface.STEEL, Surface.WHITE)[int(rng.integers(8))]
            shape += box(rng, surface, (x, y, top), (x + w, y + d, top + h), front=Surface.PARTS if surface is Surface.STEEL else None)
        x += w + rng.uniform(0.04, 0.3)
    return shape


def chair(rng: np.random.Generator) -> Piece:
    """A chair that looks along +y."""
    seat = (*COLOURS, Surface.OAK)[int(rng.integers(6))]
    shape = box(rng, seat, (-0.21, -0.21, 0.43), (0.21, 0.21, 0.47)) + box(rng, seat, (-0.21, -0.23, 0.58), (0.21, -0.19, 0.9))
    for x in (-0.21, 0.18):
        shape += box(rng, Surface.STEEL, (x, -0.22, 0), (x + 0.03, -0.19, 0.85)) + box(rng, Surface.STEEL, (x, 0.18, 0), (x + 0.03, 0.21, 0.43))
    return Piece("chair", shape, (0.46, 0.48))


def shelf(rng: np.random.Generator) -> Piece:
    """An open shelf: boards, uprights and what lies on them."""
    w, d, h = rng.uniform(0.9, 1.6), rng.uniform(0.32, 0.45), rng.uniform(1.5, 2.1)
    frame = (Surface.STEEL, Surface.OAK, Surface.BLUE)[int(rng.integers(3))]
    back = (Surface.WHITE, Surface.STEEL, Surface.WALNUT)[int(rng.integers(3))]
    shape = box(rng, back, (-w / 2, d / 2 - 0.02, 0.05), (w / 2, d / 2, h))
    for x in (-w / 2, w / 2 - 0.04):
        shape += box(rng, frame, (x, -d / 2, 0), (x + 0.04, d / 2 - 0.02, h))
    levels = np.linspace(0.1, h - 0.03, int(rng.integers(4, 6)))
    for level, above in zip(levels, np.append(levels[1:], h + 0.4), strict=True):
        shape += box(rng, frame, (-w / 2 + 0.04, -d / 2, level), (w / 2 - 0.04, d / 2 - 0.02, level + 0.025))
        shape = _stocked(rng, shape, (-w / 2 + 0.05, w / 2 - 0.05), d, (level + 0.025, above - 0.02))
    return Piece("shelf", shape, (w, d))


def _stocked(rng: np.random.Generator, shape: Shape, across: tuple[float, float], depth: float, tall: tuple[float, float]) -> Shape:
    """The shape with boxes and rows of books on one board."""
    low, high = tall
    x = across[0]
    while x < across[1] - 0.12:
        w = min(rng.uniform(0.12, 0.5), across[1] - x)
        h = min(rng.uniform(0.12, 0.36), 0.92 * (high - low))
        surface = (*COLOURS, Surface.LABELS, Surface.LABELS, Surface.CARDBOARD, Surface.WHITE, Surface.BOOKS)[int(rng.integers(10))]
        y = -depth / 2 + rng.uniform(0.01, 0.1)
        if rng.uniform() < 0.85:
            body = Surface.WHITE if surface is Surface.BOOKS else surface
            shape += box(rng, body, (x, y, low), (x + w, depth / 2 - 0.03, low + h), front=surface)
        x += w + rng.uniform(0.01, 0.12)
    return shape


def cabinet(rng: np.random.Generator) -> Piece:
    """A closed cabinet or a chest of drawers, with things on top."""
    w, d, h = rng.uniform(0.6, 1.3), rng.uniform(0.4, 0.6), rng.choice([0.85, 1.2, 1.75]) * rng.uniform(0.95, 1.05)
    body = (Surface.STEEL, Surface.WHITE, Surface.OAK, Surface.GREEN, Surface.BLUE)[int(rng.integers(5))]
    front = (Surface.DRAWERS, Surface.PARTS, body, Surface.BOOKS)[int(rng.integers(4))]
    shape = box(rng, body, (-w / 2, -d / 2, 0), (w / 2, d / 2, h), front=front)
    for x in np.arange(-w / 2, w / 2 - 0.35, 0.45):
        shape += box(rng, Surface.DARK, (x + 0.3, -d / 2 - 0.02, 0.5 * h), (x + 0.32, -d / 2, 0.5 * h + 0.14))
    return Piece("cabinet", _laden(rng, shape, (-w / 2 + 0.03, w / 2 - 0.03), d, h), (w, d + 0.04))


def crates(rng: np.random.Generator) -> Piece:
    """Stacked boxes."""
    w, d = rng.uniform(0.5, 0.9), rng.uniform(0.45, 0.7)
    kinds = (*COLOURS, Surface.LABELS, Surface.LABELS, Surface.CARDBOARD, Surface.OAK)
    boxes, z, a, b = list[Shape](), 0.0, w, d
    for _ in range(int(rng.integers(2, 5))):
        h = rng.uniform(0.22, 0.45)
        x, y = rng.uniform(-(w - a) / 2, (w - a) / 2 + 1e-9), rng.uniform(-(d - b) / 2, (d - b) / 2 + 1e-9)
        boxes.append(box(rng, kinds[int(rng.integers(len(kinds)))], (x - a / 2, y - b / 2, z), (x + a / 2, y + b / 2, z + h)))
        z, a, b = z + h, a * rng.uniform(0.75, 1.0), b * rng.uniform(0.75, 1.0)
    return Piece("crates", joined(boxes), (w, d))


def pillar(rng: np.random.Generator, height: float) -> Piece:
    """A column, round or square, up to a ceiling that is not drawn, with a painted foot."""
    if rng.uniform() < 0.5:
        r = rng.uniform(0.17, 0.25)
        foot = column(rng, Surface.YELLOW, r + PAINT, rng.uniform(0.7, 1.1))
        return Piece("pillar", column(rng, Surface.CONCRETE, r, height) + foot, (2 * r + 2 * PAINT, 2 * r + 2 * PAINT))
    r = rng.uniform(0.16, 0.24)
    shape = box(rng, Surface.CONCRETE, (-r, -r, 0), (r, r, height), front=Surface.LABELS if rng.uniform() < 0.3 else None)
    shape += box(rng, Surface.YELLOW, (-r - PAINT, -r - PAINT, 0), (r + PAINT, r + PAINT, rng.uniform(0.5, 1.0)))
    return Piece("pillar", shape, (2 * r + 2 * PAINT, 2 * r + 2 * PAINT))


def barrel(rng: np.random.Generator) -> Piece:
    """A drum for liquids."""
    r = rng.uniform(0.24, 0.3)
    return Piece("barrel", column(rng, COLOURS[int(rng.integers(4))], r, rng.uniform(0.8, 0.95)), (2 * r, 2 * r))


def low_wall(rng: np.random.Generator) -> Piece:
    """A wall of concrete, as high as a person's chest or lower."""
    length, depth, height = rng.uniform(1.5, 3.5), rng.uniform(0.25, 0.45), rng.uniform(0.6, 1.3)
    shape = box(rng, Surface.CONCRETE, (-length / 2, -depth / 2, 0), (length / 2, depth / 2, height))
    return Piece("partition", shape, (length, depth))


def bench(rng: np.random.Generator) -> Piece:
    """A bench with a back, of wood on steel feet."""
    half = rng.uniform(0.7, 1.0)
    shape = box(rng, Surface.OAK, (-half, -0.22, 0.41), (half, 0.22, 0.46)) + box(rng, Surface.OAK, (-half, 0.2, 0.6), (half, 0.24, 0.9))
    for x in (-half + 0.1, half - 0.18):
        shape += box(rng, Surface.DARK, (x, -0.2, 0), (x + 0.08, 0.2, 0.41)) + box(rng, Surface.DARK, (x, 0.2, 0), (x + 0.08, 0.24, 0.9))
    return Piece("bench", shape, (2 * half, 0.5))


CHAIR_HEIGHT, BENCH_HEIGHT = 0.47, 0.45
"""m: heights of seats above the ground."""


@dataclass(frozen=True, eq=False)
class Seating:
    """A piece and its seats: places (k, 3) m, x, y and height of each seat, in the frame of the piece."""

    piece: Piece
    places: Array


def single_chair(rng: np.random.Generator) -> Seating:
    """A chair alone."""
    return Seating(chair(rng), np.array([[0.0, 0.0, CHAIR_HEIGHT]]))


def bench_for_sitting(rng: np.random.Generator) -> Seating:
    """A bench for two or three, with or without a back."""
    count, wood = int(rng.integers(2, 4)), (Surface.OAK, Surface.WALNUT, Surface.DARK, Surface.GREEN)[int(rng.integers(4))]
    half = 0.3 * count + 0.1
    shape = box(rng, wood, (-half, -0.2, BENCH_HEIGHT - 0.05), (half, 0.2, BENCH_HEIGHT))
    back = rng.random() < 0.6
    if back:
        shape += box(rng, wood, (-half, -0.25, 0.58), (half, -0.21, 0.88))
    for x in (-half + 0.1, half - 0.16):
        shape += box(rng, Surface.DARK, (x, -0.2, 0), (x + 0.06, 0.18, BENCH_HEIGHT - 0.05))
        if back:
            shape += box(rng, Surface.DARK, (x, -0.21, BENCH_HEIGHT - 0.05), (x + 0.06, -0.19, 0.88))
    places = [[0.6 * (k - (count - 1) / 2), 0.0, BENCH_HEIGHT] for k in range(count)]
    return Seating(Piece("bench", shape, (2 * half, 0.5)), np.array(places))


def table_and_chair(rng: np.random.Generator) -> Seating:
    """A table with things on it, and a chair at its front."""
    desk, seat = table(rng), chair(rng)
    shift = desk.size[1] / 2 + 0.16
    total = desk.size[1] + 0.5
    # The piece stands around the middle of both.
    back = 0.5 * total - desk.size[1] / 2
    shape = desk.shape.moved((0.0, back, 0.0)) + seat.shape.moved((0.0, back - shift, 0.0))
    return Seating(Piece("table", shape, (desk.size[0], total)), np.array([[0.0, back - shift, CHAIR_HEIGHT]]))


SEATINGS: tuple[Callable[[np.random.Generator], Seating], ...] = (single_chair, bench_for_sitting, table_and_chair)
"""One function for each kind."""
