"""Textures of floors, one for a whole terrain, so that nothing repeats and features are unique."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from worlds.terrain.heightfield import Heightfield, Mask
from worlds.terrain.polygons import signed_distance
from worlds.terrain.relief import Pattern, fractal, noise
from worlds.textures.materials import Canvas, tint

# Pixels a metre: from a robot's eye at 0.6 m a panorama of 1024 pixels sees no more than about 110 of them in a metre of floor.
SCALE = 96.0
# Least rise between neighbouring grid points, m, of an edge that is painted as a hazard.
HAZARD = 0.06


def floor(rng: np.random.Generator, ground: Heightfield) -> Canvas:
    """Worn tiles of different tones, with stains, chips, scuffs and tape; as large as the ground."""
    low, high = ground.extent
    width, height = high - low
    canvas = Canvas(width, height, SCALE, tint(rng, (158, 152, 142), 4))
    _tiles(canvas, rng, 0.6)
    _stains(canvas, rng)
    for _ in range(int(width * height / 9)):
        _scuff(canvas, rng)
    return canvas


def _tiles(canvas: Canvas, rng: np.random.Generator, size: float) -> None:
    rows, columns = (int(n / size) + 1 for n in (canvas.height, canvas.width))
    tone = rng.normal(0, 0.045, (rows, columns))
    odd = rng.uniform(size=(rows, columns)) < 0.05
    tone[odd] += rng.uniform(-0.3, 0.12, int(odd.sum()))
    for i in range(rows):
        for j in range(columns):
            x, y = j * size, i * size
            canvas.shade((x, y, x + size, y + size), tone[i, j])
    grout = np.array([112, 106, 98])
    for x in np.arange(0, canvas.width, size):
        canvas.fill((x, 0, x + 0.012, canvas.height), grout, 0.6)
    for y in np.arange(0, canvas.height, size):
        canvas.fill((0, y, canvas.width, y + 0.012), grout, 0.6)


def _stains(canvas: Canvas, rng: np.random.Generator) -> None:
    """Unevenness of tone at every scale: wear over metres, stains over decimetres, chips of stone over millimetres."""
    shape = canvas.pixels.shape[:2]
    canvas.mottle(rng, canvas.box, 0.18, 3.0, 7)
    stain = fractal(rng, shape, 0.8 * SCALE, 5)
    canvas.shade(canvas.box, -0.35 * np.clip(2.5 * (stain - 0.28), 0.0, 1.0))
    chips = noise(rng, shape, 2.2)
    bits = np.where(chips > 0.45, 26 * chips, np.where(chips < -0.45, 32 * chips, 0)).astype(np.float32)
    canvas.pixels += bits[..., None] * np.array([1.15, 1.0, 0.8], dtype=np.float32)


def _scuff(canvas: Canvas, rng: np.random.Generator) -> None:
    """A smear of rubber, or a drip of paint, or a strip of tape."""
    x, y = rng.uniform(0, canvas.width), rng.uniform(0, canvas.height)
    kind = rng.uniform()
    if kind < 0.6:
        long, thin = rng.uniform(0.1, 0.9), rng.uniform(0.015, 0.05)
        box = (x, y, x + long, y + thin) if kind < 0.3 else (x, y, x + thin, y + long)
        canvas.mottle(rng, box, 0.5, 0.1, 3)
    elif kind < 0.85:
        for _ in range(int(rng.integers(2, 9))):
            canvas.disc((x + rng.normal(0, 0.08), y + rng.normal(0, 0.08)), rng.uniform(0.005, 0.03), tint(rng, (120, 112, 104), 40))
    else:
        canvas.fill((x, y, x + rng.uniform(0.2, 0.6), y + 0.05), tint(rng, (190, 160, 60), 30), 0.8)


def planks(canvas: Canvas, rng: np.random.Generator, ground: Heightfield, corners: ArrayLike) -> None:
    """Plywood or timber over a polygon (k, 2) m of the ground: boards side by side, each with its grain."""
    w, inside = _region(canvas, ground, corners)
    rows, columns = w.shape[:2]
    board = int(rng.uniform(0.18, 0.3) * SCALE)
    lanes = np.arange(rows) // board
    tones = rng.uniform(0.78, 1.12, lanes.max() + 1)
    wood = np.array([178, 138, 94], dtype=np.float32) * (tones[lanes][:, None, None]).astype(np.float32)
    grain = noise(rng, (rows, columns), (3.0, 60.0)) * 0.10 + fractal(rng, (rows, columns), 0.7 * SCALE, 6) * 0.22
    painted = wood * (1 + grain[..., None])
    painted[np.arange(rows) % board < 2] *= 0.55
    nails = noise(rng, (rows, columns), 3.0) > 0.86
    painted[nails] *= 0.6
    w[inside] = painted[inside]


def matting(canvas: Canvas, rng: np.random.Generator, ground: Heightfield, corners: ArrayLike, colour: ArrayLike) -> None:
    """Rubber or carpet of a colour over a polygon (k, 2) m of the ground."""
    w, inside = _region(canvas, ground, corners)
    shape = w.shape[:2]
    painted = np.asarray(colour, dtype=np.float32) * (1 + 0.22 * fractal(rng, shape, 1.2 * SCALE, 8) + 0.14 * noise(rng, shape, 2.0))[..., None]
    w[inside] = painted[inside]


def lane(canvas: Canvas, rng: np.random.Generator, ground: Heightfield, points: ArrayLike, colour: ArrayLike) -> None:
    """A worn painted line, 7 cm wide, along a polyline (k, 2) m of the ground whose segments run along x or y."""
    corners = np.asarray(points, dtype=np.float64)
    for a, b in pairwise(corners):
        low, high = np.minimum(a, b) - 0.035 - ground.origin, np.maximum(a, b) + 0.035 - ground.origin
        w = canvas.window((low[0], low[1], high[0], high[1]))
        if w.size:
            wear = fractal(rng, w.shape[:2], 0.5 * SCALE, 6)
            opacity = np.clip(0.85 - 2.2 * np.clip(wear - 0.05, 0, 1), 0, 1)[..., None]
            w += opacity * (np.asarray(colour, dtype=np.float32) - w)


def hazards(canvas: Canvas, ground: Heightfield) -> None:
    """Black and yellow stripes along every step of the ground, as safety regulations require."""
    rise = ground.rise > HAZARD
    rows, columns = canvas.pixels.shape[:2]
    i = np.linspace(ground.heights.shape[0] - 1, 0, rows)
    j = np.linspace(0, ground.heights.shape[1] - 1, columns)
    step = rise[np.rint(i).astype(int)][:, np.rint(j).astype(int)]
    y, x = np.nonzero(step)
    dark = (x + y) % round(0.28 * SCALE) < round(0.14 * SCALE)
    grime = 0.82 + 0.18 * canvas.pixels[y, x].mean(axis=1, keepdims=True) / 150
    canvas.pixels[y, x] = np.where(dark[:, None], [44, 42, 40], [214, 170, 44]) * grime


def _region(canvas: Canvas, ground: Heightfield, corners: ArrayLike) -> tuple[Pattern, Mask]:
    """The pixels in a polygon's bounding box, and which of them lie in the polygon."""
    polygon = np.asarray(corners, dtype=np.float64) - ground.origin
    low, high = np.maximum(polygon.min(axis=0), 0), polygon.max(axis=0)
    w = canvas.window((low[0], low[1], high[0], high[1]))
    rows, columns = w.shape[:2]
    top = min(round(high[1] * SCALE), canvas.pixels.shape[0])
    x = (round(low[0] * SCALE) + np.arange(columns) + 0.5) / SCALE
    y = (top - np.arange(rows) - 0.5) / SCALE
    return w, signed_distance(np.stack(np.meshgrid(x, y), axis=-1), polygon) <= 0
