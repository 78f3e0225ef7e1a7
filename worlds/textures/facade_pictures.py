"""Pictures of building fronts: bays with a window each, side by side in one picture."""

from __future__ import annotations

import numpy as np

from worlds.terrain.heightfield import Array
from worlds.textures.canvas import Box, Canvas, tint
from worlds.textures.masonry import brick, concrete, plaster

BAY, STOREY = 3.0, 3.2
"""m: width of a bay and height of a storey."""
VARIANTS = 4
"""Bays of a picture; the last one has no window."""


def bay_box(variant: int) -> Array:
    """Texture coordinates [[u0, v0], [u1, v1]] of a bay, v downwards in the picture."""
    return np.array([[variant / VARIANTS, 0.0], [(variant + 1) / VARIANTS, 1.0]])


def facade(rng: np.random.Generator) -> tuple[Canvas, Box]:
    """The picture of the bays of a front, and the pane of its windows.

    The pane is x0, y0, x1, y1 m from the lower left corner of a bay.
    """
    material = (brick, brick, plaster, concrete)[int(rng.integers(4))]
    canvas = material(rng, VARIANTS * BAY, STOREY, 0.0)
    width, sill, top = rng.uniform(1.0, 2.4), rng.uniform(0.7, 1.1), rng.uniform(2.3, 2.7)
    pane = ((BAY - width) / 2, sill, (BAY + width) / 2, top)
    frame = tint(rng, ((236, 234, 228), (92, 44, 36), (60, 64, 68), (150, 152, 150))[int(rng.integers(4))], 8)
    glass = tint(rng, ((46, 58, 70), (70, 88, 104), (96, 116, 132))[int(rng.integers(3))], 8)
    mullions = int(rng.integers(1, 4))
    for variant in range(VARIANTS - 1):
        x0, y0, x1, y1 = (value + side * variant * BAY for value, side in zip(pane, (1, 0, 1, 0), strict=True))
        canvas.fill((x0, y0, x1, y1), glass)
        rows = canvas.window((x0, y0, x1, y1)).shape[0]
        # The upper part of a pane mirrors the sky, the lower one what is across the street.
        canvas.shade((x0, y0, x1, y1), np.linspace(rng.uniform(0.2, 0.7), rng.uniform(-0.4, 0.0), rows)[:, None])
        canvas.mottle(rng, (x0, y0, x1, y1), 0.3, 0.8, 3)
        if rng.uniform() < 0.5:
            canvas.fill((x0, rng.uniform(y0 + 0.4, y1 - 0.2), x1, y1), tint(rng, (212, 206, 192), 8), 0.7)
        for k in range(1, mullions + 1):
            x = x0 + k * (x1 - x0) / (mullions + 1)
            canvas.fill((x - 0.03, y0, x + 0.03, y1), frame)
        canvas.frame((x0, y0, x1, y1), frame, 0.07)
        canvas.fill((x0 - 0.1, y0 - 0.1, x1 + 0.1, y0), tint(rng, (176, 172, 164)))
        canvas.shade((x0 - 0.1, y0 - 0.16, x1 + 0.1, y0 - 0.1), -0.35)
    canvas.shade((0.0, STOREY - 0.05, canvas.width, STOREY), -0.2)
    return canvas, pane
