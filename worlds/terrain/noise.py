"""Smooth random patterns on grids, for relief and for paint. Only additions and products of gathered values: the same bits anywhere."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Pattern = NDArray[np.float32]


def noise(rng: np.random.Generator, shape: tuple[int, int], period: float | tuple[float, float]) -> Pattern:
    """Value noise of that shape in [−1, 1]: random values every `period` samples (of rows and of columns, or of both), blended between.

    The blend has two continuous derivatives (Perlin 2002, "Improving Noise").
    """
    periods = period if isinstance(period, tuple) else (period, period)
    size = [int(n / p) + 3 for n, p in zip(shape, periods, strict=True)]
    values = rng.uniform(-1, 1, size).astype(np.float32)
    for n, p in zip(shape, periods, strict=True):
        t = np.arange(n) / p + rng.uniform()
        i = t.astype(np.int64)
        f = t - i
        blend = (f * f * f * (f * (f * 6 - 15) + 10)).astype(np.float32)[:, None]
        # Rows first, then, transposed, columns; the second transposition brings rows back.
        values = (values[i] + (values[i + 1] - values[i]) * blend).T
    return values


def fractal(rng: np.random.Generator, shape: tuple[int, int], period: float, octaves: int) -> Pattern:
    """A sum of noises, each of half the period and 0.6 of the height of the one before, scaled to [−1, 1]."""
    heights = 0.6 ** np.arange(octaves)
    heights = (heights / heights.sum()).astype(np.float32)
    total = np.zeros(shape, dtype=np.float32)
    for k, height in enumerate(heights):
        total += height * noise(rng, shape, max(1.0, period / 2**k))
    return total
