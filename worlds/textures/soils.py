"""Textures of open ground, one for a whole terrain: two soils in patches, bare steep ground, specks and blades at every scale."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from worlds.terrain.heightfield import Array, Heightfield
from worlds.terrain.relief import Pattern, fractal, noise
from worlds.textures.materials import Canvas

PIXELS = 1792
"""Along the longer side of the picture."""

Colour = tuple[float, float, float]


@dataclass(frozen=True)
class Soil:
    """Colours in [0, 255]: plain and other, in patches of about `patch` m; bare, where the ground is steeper than `steep` rad."""

    plain: Colour
    other: Colour
    bare: Colour
    steep: float
    patch: float


def soil(rng: np.random.Generator, ground: Heightfield, kind: Soil) -> Canvas:
    """The picture of a terrain."""
    low, high = ground.extent
    width, height = (float(s) for s in high - low)
    scale = PIXELS / max(width, height)
    canvas = Canvas(width, height, scale, kind.plain)
    shape = canvas.pixels.shape[:2]
    _mix(canvas, np.clip(0.5 + 3.0 * fractal(rng, shape, kind.patch * scale, 7), 0, 1), kind.other)
    rough = 0.25 * fractal(rng, shape, 1.2 * scale, 6)
    _mix(canvas, np.clip((_on_picture(ground.slope, shape) - kind.steep) / 0.15 + rough * 4, 0, 1), kind.bare)
    # Hollows are damp and dark, crests are dry and light.
    relief = ground.heights - ndimage.gaussian_filter(ground.heights, 1.5 / ground.spacing)
    canvas.shade(canvas.box, np.clip(0.5 * _on_picture(relief, shape), -0.2, 0.2))
    canvas.mottle(rng, canvas.box, 0.26, 2.5, 8)
    blades = noise(rng, shape, (5.0, 1.6))
    canvas.shade(canvas.box, 0.14 * blades)
    canvas.speckle(rng, canvas.box, 0.25, 0.10)
    return canvas


def trail(canvas: Canvas, near: Array, colour: Colour, width: float) -> None:
    """Paint a worn path. near (rows, columns): m of every grid point from its centre line. width: m from there to its edge."""
    worn = np.clip(1.4 - 1.4 * _on_picture(near, canvas.pixels.shape[:2]) / width, 0, 1) * 0.75
    _mix(canvas, worn, colour)


def _mix(canvas: Canvas, share: Pattern, colour: Colour) -> None:
    canvas.pixels += share.astype(np.float32)[..., None] * (np.array(colour, dtype=np.float32) - canvas.pixels)


def _on_picture(values: Array, shape: tuple[int, int]) -> Pattern:
    """Values on the grid (rows, columns), row 0 at the lowest y → on the picture, row 0 on top."""
    v = values[::-1].astype(np.float32)
    zoom = [n / m for n, m in zip(shape, v.shape, strict=True)]
    out = ndimage.zoom(v, zoom, order=1, grid_mode=True, mode="nearest")
    return np.asarray(out[: shape[0], : shape[1]])
