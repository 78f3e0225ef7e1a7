"""Things that a detector takes for people at a distance: street furniture, things on tripods, clothes, pictures."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from worlds.props.furniture import COLOURS, Piece
from worlds.props.revolution import CLOTHES, revolved
from worlds.props.shapes import box
from worlds.props.standing_objects import cardboard_figure, clothes_heap, poster, pram, tripod
from worlds.textures.furniture_atlas import Surface


def cone(rng: np.random.Generator) -> Piece:
    """A traffic cone with a white band."""
    h, r = rng.uniform(0.45, 1.0), rng.uniform(0.12, 0.19)
    shape = box(rng, Surface.DARK, (-r - 0.04, -r - 0.04, 0), (r + 0.04, r + 0.04, 0.03))
    for surface, low, high in ((Surface.RED, 0.0, 0.45), (Surface.WHITE, 0.45, 0.72), (Surface.RED, 0.72, 1.0)):
        shape += revolved(rng, surface, [(r * (1 - 0.85 * t) + (0.0 if t < 1 else -0.01), 0.03 + h * t) for t in (low, high)])
    return Piece("cone", shape, (2 * r + 0.08, 2 * r + 0.08))


def bollard(rng: np.random.Generator) -> Piece:
    """A post as high as a hip."""
    h, r = rng.uniform(0.7, 1.3), rng.uniform(0.06, 0.14)
    surface = (Surface.DARK, Surface.STEEL, Surface.CONCRETE, Surface.GREEN)[int(rng.integers(4))]
    return Piece("bollard", revolved(rng, surface, [(r, 0), (r, h - r), (0.7 * r, h - 0.3 * r), (0.01, h)]), (2 * r, 2 * r))


def barrier(rng: np.random.Generator) -> Piece:
    """Striped boards between two posts."""
    w, h = rng.uniform(0.9, 1.6), rng.uniform(0.9, 1.15)
    shape = box(rng, Surface.DARK, (-w / 2, -0.2, 0), (-w / 2 + 0.06, 0.2, 0.06))
    shape += box(rng, Surface.DARK, (w / 2 - 0.06, -0.2, 0), (w / 2, 0.2, 0.06))
    for x in (-w / 2, w / 2 - 0.05):
        shape += box(rng, Surface.STEEL, (x, -0.025, 0.06), (x + 0.05, 0.025, h))
    for z in (h - 0.22, h - 0.55):
        for k, (a, b) in enumerate(zip(np.linspace(-0.5, 0.5, 7)[:-1], np.linspace(-0.5, 0.5, 7)[1:], strict=True)):
            shape += box(rng, (Surface.RED, Surface.WHITE)[k % 2], (a * w, -0.045, z), (b * w, -0.025, z + 0.2))
    return Piece("barrier", shape, (w, 0.4))


def sign(rng: np.random.Generator) -> Piece:
    """A board on a post, at the height of a head or above."""
    h, w = rng.uniform(1.3, 2.5), rng.uniform(0.3, 0.6)
    shape = revolved(rng, Surface.DARK, [(0.15, 0), (0.15, 0.04), (0.03, 0.05), (0.03, h), (0.005, h + 0.01)])
    shape += box(rng, Surface.WHITE, (-w / 2, -0.05, h - w), (w / 2, -0.032, h), front=(*COLOURS, Surface.LABELS)[int(rng.integers(6))])
    return Piece("sign", shape, (max(w, 0.3), 0.3))


def coat_stand(rng: np.random.Generator) -> Piece:
    """A stand with a coat over it, and sometimes a hat: a person without legs."""
    h, r, flat = rng.uniform(1.55, 1.9), rng.uniform(0.19, 0.27), rng.uniform(0.5, 0.8)
    shape = revolved(rng, Surface.DARK, [(0.2, 0), (0.2, 0.03), (0.025, 0.04), (0.025, h), (0.005, h + 0.01)])
    hem, top = rng.uniform(0.35, 0.85), h - rng.uniform(0.05, 0.25)
    cloth = CLOTHES[int(rng.integers(len(CLOTHES)))]
    shape += revolved(rng, cloth, [(0.02, hem - 0.001), (r, hem), (0.8 * r, 0.5 * (hem + top)), (0.85 * r, top - 0.12), (0.06, top)], flat)
    if rng.uniform() < 0.4:
        shape += revolved(rng, cloth, [(0.02, h - 0.01), (0.14, h), (0.1, h + 0.02), (0.09, h + 0.1), (0.005, h + 0.12)])
    return Piece("coat_stand", shape, (max(2 * r, 0.4), max(2 * r, 0.4)))


def litter_bin(rng: np.random.Generator) -> Piece:
    """A round bin with a lid."""
    h, r = rng.uniform(0.75, 1.2), rng.uniform(0.2, 0.3)
    shape = revolved(rng, (Surface.DARK, Surface.GREEN, Surface.STEEL)[int(rng.integers(3))], [(0.8 * r, 0), (r - 0.02, h)])
    shape += revolved(rng, Surface.DARK, [(r - 0.02, h - 0.02), (r, h), (0.8 * r, h + 0.08), (0.01, h + 0.12)])
    return Piece("bin", shape, (2 * r, 2 * r))


STREET: tuple[Callable[[np.random.Generator], Piece], ...] = (cone, bollard, barrier, sign, coat_stand, litter_bin)
"""Kinds of the first scenes for training."""
MAKERS = (*STREET, tripod, clothes_heap, pram, poster, cardboard_figure)
"""One function for each kind."""
