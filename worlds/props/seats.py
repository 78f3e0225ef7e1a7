"""Seats for people: chairs, benches, and chairs behind tables. A seat looks along +y of its piece."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from worlds.props.furniture import Piece, chair, table
from worlds.props.shapes import Shape, box
from worlds.terrain.heightfield import Array
from worlds.textures.furniture_atlas import Surface

CHAIR_HEIGHT, BENCH_HEIGHT = 0.47, 0.45
"""m above the ground of the upper side of a seat."""


@dataclass(frozen=True, eq=False)
class Seating:
    """A piece and its places to sit: places (k, 3) m of x, y and height of the seat, in the frame of the piece."""

    piece: Piece
    places: Array


def single_chair(rng: np.random.Generator) -> Seating:
    """A chair alone."""
    return Seating(chair(rng), np.array([[0.0, 0.0, CHAIR_HEIGHT]]))


def bench(rng: np.random.Generator) -> Seating:
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
    shape = _moved(desk.shape, (0.0, back, 0.0)) + _moved(seat.shape, (0.0, back - shift, 0.0))
    return Seating(Piece("table", shape, (desk.size[0], total)), np.array([[0.0, back - shift, CHAIR_HEIGHT]]))


def _moved(shape: Shape, offset: ArrayLike) -> Shape:
    return replace(shape, vertices=shape.vertices + np.asarray(offset, dtype=np.float64))


SEATINGS: tuple[Callable[[np.random.Generator], Seating], ...] = (single_chair, bench, table_and_chair)
"""One function for each kind."""
