"""Objects that a detector takes for people at a distance: street furniture, instruments on tripods, clothes, pictures of people."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from worlds.props.furniture import COLOURS, Piece
from worlds.props.shapes import CLOTHES, Shape, box, joined, revolved
from worlds.terrain.heightfield import Array
from worlds.textures.furniture_atlas import Surface, crop
from worlds.textures.person_pictures import COUNT, HEIGHT, WIDTH, silhouette, texture_of


def bar(rng: np.random.Generator, surface: Surface, start: ArrayLike, end: ArrayLike, half: float) -> Shape:
    """A square bar from start (3,) m to end (3,) m, of half that width m, with open ends."""
    a, b = np.asarray(start, dtype=np.float64), np.asarray(end, dtype=np.float64)
    along = (b - a) / np.linalg.norm(b - a)
    x = np.cross(along, np.eye(3)[int(np.argmin(np.abs(along)))])
    x /= np.linalg.norm(x)
    y = np.cross(along, x)
    ring = [half * (i * x + j * y) for i, j in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    (u0, v0), (u1, v1) = crop(rng, surface, (2 * half, float(np.linalg.norm(b - a))))
    vertices, faces, texcoord = [], [], []
    for k in range(4):
        p, q = ring[k], ring[(k + 1) % 4]
        faces += [[4 * k, 4 * k + 1, 4 * k + 2], [4 * k, 4 * k + 2, 4 * k + 3]]
        vertices += [a + p, a + q, b + q, b + p]
        texcoord += [(u0, v1), (u1, v1), (u1, v0), (u0, v0)]
    return Shape(np.array(vertices), np.array(faces), np.array(texcoord))


def tripod(rng: np.random.Generator) -> Piece:
    """Three legs with an instrument, a camera or a lamp on top, as high as a head."""
    h, spread = rng.uniform(1.1, 1.75), rng.uniform(0.28, 0.45)
    turn, leg = rng.uniform(0, 2 * np.pi), (Surface.DARK, Surface.YELLOW, Surface.OAK, Surface.STEEL)[int(rng.integers(4))]
    angles = turn + 2 * np.pi / 3 * np.arange(3)
    shape = revolved(rng, Surface.DARK, [(0.05, 0.9 * h - 0.06), (0.05, 0.9 * h), (0.02, 0.9 * h + 0.01), (0.02, h - 0.05), (0.005, h - 0.04)])
    for angle in angles:
        foot = spread * np.array([np.cos(angle), np.sin(angle)])
        shape += bar(rng, leg, [*foot, 0.01], [*(0.1 * foot), 0.9 * h], rng.uniform(0.012, 0.022))
    w, d, top = rng.uniform(0.07, 0.2), rng.uniform(0.06, 0.12), rng.uniform(0.1, 0.28)
    shape += box(rng, (Surface.DARK, Surface.YELLOW, Surface.WHITE)[int(rng.integers(3))], (-w, -d, h - 0.05), (w, d, h - 0.05 + top))
    return Piece("tripod", shape, (2 * spread + 0.05, 2 * spread + 0.05))


def clothes_heap(rng: np.random.Generator) -> Piece:
    """A heap of garments, at most as high as a crouching child."""
    lumps = []
    for k in range(int(rng.integers(4, 9))):
        r, h = rng.uniform(0.16, 0.34), rng.uniform(0.1, 0.22)
        x, y = rng.uniform(-0.22, 0.22, 2)
        z = 0.0 if k < 2 else rng.uniform(0.03, 0.06 * k)
        cloth = CLOTHES[int(rng.integers(len(CLOTHES)))]
        lump = _crumpled(rng, revolved(rng, cloth, [(0.9 * r, 0), (r, 0.25 * h), (0.8 * r, 0.65 * h), (0.4 * r, 0.93 * h), (0.01, h)]))
        lumps.append(lump.moved((x, y, z)))
    shape = joined(lumps)
    reach = float(np.abs(shape.vertices[:, :2]).max())
    return Piece("heap", shape, (2 * reach, 2 * reach))


def _crumpled(rng: np.random.Generator, shape: Shape) -> Shape:
    """The shape with folds: radii change with the angle about z, differently at every height; the seam stays closed."""
    x, y, z = shape.vertices.T
    angle = np.arctan2(y, x)
    fold = sum(rng.uniform(0.04, 0.16) * np.cos(n * angle + rng.uniform(0, 2 * np.pi) + rng.uniform(-9, 9) * z) for n in (2, 3, 5))
    return replace(shape, vertices=np.column_stack([x * (1 + fold), y * (1 + fold), z * (1 + 0.3 * fold)]))


def pram(rng: np.random.Generator) -> Piece:
    """A pram with its hood up: wheels, a carrycot and a bar to push it by."""
    cloth = CLOTHES[int(rng.integers(len(CLOTHES)))]
    length, half, low = rng.uniform(0.36, 0.44), rng.uniform(0.17, 0.22), rng.uniform(0.42, 0.55)
    cot = revolved(rng, cloth, [(0.01, 0.0), (0.75, 0.02), (0.95, 0.12), (1.0, 0.26), (0.94, 0.27), (0.01, 0.2)])
    shape = replace(cot, vertices=cot.vertices * [length, half, 1.0] + [0, 0, low])
    hood = revolved(rng, cloth, [(1.0, 0.0), (0.97, 0.09), (0.8, 0.18), (0.45, 0.24), (0.01, 0.26)])
    shape += replace(hood, vertices=hood.vertices * [0.55 * length, half, 1.0] + [-0.45 * length, 0, low + 0.25])
    flat = np.array([[1.0, 0, 0], [0, 0, -1.0], [0, 1.0, 0]])
    r = rng.uniform(0.1, 0.16)
    for x in (-0.8 * length, 0.8 * length):
        for y in (-half, half):
            wheel = revolved(rng, Surface.DARK, [(0.01, -0.02), (r, -0.015), (r, 0.015), (0.01, 0.02)])
            shape += wheel.moved((x, y, r), flat)
            shape += bar(rng, Surface.STEEL, (x, y, r), (-0.5 * x, 0.8 * y, low + 0.05), 0.012)
    for y in (-0.8 * half, 0.8 * half):
        shape += bar(rng, Surface.STEEL, (-0.7 * length, y, low + 0.1), (-length - 0.28, y, 1.02), 0.012)
    shape += bar(rng, Surface.DARK, (-length - 0.28, -half, 1.02), (-length - 0.28, half, 1.02), 0.018)
    return Piece("pram", shape, (2 * length + 0.6, 2 * half + 0.06))


def poster(rng: np.random.Generator) -> Piece:
    """A board on feet that shows a person, at about life size or smaller."""
    cell, scale, lift = int(rng.integers(COUNT)), rng.uniform(0.7, 1.15), rng.uniform(0.05, 0.4)
    w, h = scale * WIDTH, scale * HEIGHT
    shape = box(rng, Surface.WHITE, (-w / 2 - 0.03, -0.015, lift - 0.03), (w / 2 + 0.03, 0.02, lift + h + 0.03))
    for x in (-w / 2, w / 2 - 0.04):
        shape += box(rng, Surface.STEEL, (x, -0.25, 0), (x + 0.04, 0.25, 0.04)) + box(rng, Surface.STEEL, (x, 0.02, 0), (x + 0.04, 0.06, lift + h))
    corners = np.array([[-0.5, 0.0], [0.5, 0.0], [0.5, 1.0], [-0.5, 1.0]]) * [WIDTH, HEIGHT]
    return Piece("poster", shape, (w + 0.06, 0.5), _plate(corners, cell, scale, (-0.018, -0.016)).moved((0, 0, lift)))


def cardboard_figure(rng: np.random.Generator) -> Piece:
    """A cardboard figure of a person, on a foot."""
    cell, scale = int(rng.integers(COUNT)), rng.uniform(0.9, 1.1)
    shape = box(rng, Surface.DARK, (-0.25, -0.2, 0), (0.25, 0.2, 0.02)) + bar(rng, Surface.DARK, (0, 0.18, 0.02), (0, 0.01, 0.8), 0.015)
    # Parts that overlap lie at different depths, so that the last one is in front.
    deep = [0.006 + 0.0006 * k for k in range(len(silhouette(cell)))]
    figure = joined([_plate(corners, cell, scale, (-y, y)) for (_, corners), y in zip(silhouette(cell), deep, strict=True)])
    width = 2 * float(np.abs(figure.vertices[:, 0]).max())
    return Piece("figure", shape, (max(width, 0.5), 0.42), figure.moved((0, 0, 0.02)))


def _plate(corners: Array, cell: int, scale: float, sides: tuple[float, float]) -> Shape:
    """A convex polygon (k, 2) m of x and z, times `scale`, with the picture of a cell in front and at the back, at y of `sides` m."""
    k = len(corners)
    fan = np.array([[0, j, j + 1] for j in range(1, k - 1)])
    front, back = (np.column_stack([scale * corners[:, 0], np.full(k, y), scale * corners[:, 1]]) for y in sides)
    return Shape(front, fan, texture_of(cell, corners)) + Shape(back, fan[:, ::-1], texture_of(cell, corners))


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
    """A stand with a coat over it, and sometimes a hat. It resembles a person without legs."""
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


MAKERS: tuple[Callable[[np.random.Generator], Piece], ...] = (
    cone, bollard, barrier, sign, coat_stand, litter_bin, tripod, clothes_heap, pram, poster, cardboard_figure,
)  # fmt: skip
"""One function for each kind."""
