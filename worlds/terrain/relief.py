"""Smooth random patterns on grids, for relief and for textures, and pieces of relief to be added, or combined by their maximum.

Patterns use only additions and products of gathered values, so that machines agree bit by bit. Each piece of relief gives heights
(rows, columns) m over grid points (rows, columns, 2) m, such as Heightfield.nodes.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from worlds.terrain.heightfield import Array
from worlds.terrain.polygons import signed_distance

Pattern = NDArray[np.float32]


def noise(rng: np.random.Generator, shape: tuple[int, int], period: float | tuple[float, float]) -> Pattern:
    """Value noise of that shape in [−1, 1]: random values every `period` samples (of rows and of columns, or of both), interpolated between.

    The interpolation has two continuous derivatives (Perlin 2002, "Improving Noise").
    """
    periods = period if isinstance(period, tuple) else (period, period)
    size = [int(n / p) + 3 for n, p in zip(shape, periods, strict=True)]
    values = rng.uniform(-1, 1, size).astype(np.float32)
    for n, p in zip(shape, periods, strict=True):
        t = np.arange(n) / p + rng.uniform()
        i = t.astype(np.int64)
        f = t - i
        blend = (f * f * f * (f * (f * 6 - 15) + 10)).astype(np.float32)[:, None]
        # Each pass interpolates along rows and transposes; after the second pass, rows are rows again.
        values = (values[i] + (values[i + 1] - values[i]) * blend).T
    return values


def fractal(rng: np.random.Generator, shape: tuple[int, int], period: float, octaves: int) -> Pattern:
    """A sum of noises, each of half the period and 0.6 of the amplitude of the one before, scaled to [−1, 1]."""
    heights = 0.6 ** np.arange(octaves)
    heights = (heights / heights.sum()).astype(np.float32)
    total = np.zeros(shape, dtype=np.float32)
    for k, height in enumerate(heights):
        total += height * noise(rng, shape, max(1.0, period / 2**k))
    return total


def swell(rng: np.random.Generator, nodes: Array, wavelength: float, height: float) -> Array:
    """Smooth unevenness within ± height m, with a hump or a hollow about every `wavelength` m."""
    spacing = float(nodes[0, 1, 0] - nodes[0, 0, 0])
    rows, columns, _ = nodes.shape
    return height * noise(rng, (rows, columns), wavelength / spacing).astype(np.float64)


def plateau(nodes: Array, corners: ArrayLike, height: float) -> Array:
    """`height` m within a polygon (k, 2) m, 0 outside: the edge is a step, one cell wide."""
    return np.where(signed_distance(nodes, corners) <= 0, height, 0.0)


def ramp(nodes: Array, foot: ArrayLike, top: ArrayLike, width: float, height: float) -> Array:
    """A plane that rises from 0 at the foot (2,) m to `height` m at the top (2,) m, `width` m across; 0 beside, before and behind."""
    start, end = np.asarray(foot, dtype=np.float64), np.asarray(top, dtype=np.float64)
    length = float(np.hypot(*(end - start)))
    ahead = (end - start) / length
    along = (nodes - start) @ ahead
    across = np.abs((nodes - start) @ np.array([-ahead[1], ahead[0]]))
    on = (along >= 0) & (along <= length + 1e-9) & (across <= width / 2 + 1e-9)
    return np.where(on, height * along / length, 0.0)


def rubble(rng: np.random.Generator, nodes: Array, centre: ArrayLike, radius: float, height: float) -> Array:
    """Broken ground up to `height` m, with lumps about every 0.5 m, within `radius` m of the centre (2,) m and fading to its edge."""
    distance = np.hypot(*np.moveaxis(nodes - np.asarray(centre, dtype=np.float64), -1, 0))
    fade = np.clip(1 - distance / radius, 0.0, 1.0)
    lumps = 0.5 * (1 + swell(rng, nodes, 0.5, 1.0))
    return height * lumps * np.minimum(1.0, 2 * fade)
