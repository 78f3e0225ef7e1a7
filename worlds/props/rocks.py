"""Boulders and stones. They are convex, so that the rendered and the colliding shape are the same."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from worlds.props.meshes import PERIOD, hull
from worlds.props.shapes import Shape

CORNERS = 34


def boulder(rng: np.random.Generator, size: ArrayLike) -> Shape:
    """A stone around the origin, its half lengths size (3,) m: edges where it broke, round where it did not. Some 60 triangles."""
    half = np.asarray(size, dtype=np.float64)
    direction = rng.normal(size=(CORNERS, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    # Planes that cut the ball leave facets.
    cut = rng.normal(size=(5, 3))
    cut /= np.linalg.norm(cut, axis=1, keepdims=True)
    reach = rng.uniform(0.9, 1.0, CORNERS)
    for plane in cut:
        beyond = np.maximum(direction @ plane, 1e-9)
        reach = np.minimum(reach, rng.uniform(0.62, 0.85) / beyond)
    return hull(direction * reach[:, None] * half, rng.uniform(0, PERIOD, 2))


def stone_sizes(rng: np.random.Generator, count: int, least: float, most: float) -> np.ndarray:
    """Half lengths (count, 3) m of stones: many small ones and few large ones (a power law, as fragments have; Turcotte 1986), flatter than wide."""
    u = rng.uniform(0, 1, count)
    mean = least * (1 - u * (1 - (least / most) ** 2)) ** -0.5
    return mean[:, None] * rng.uniform(0.75, 1.25, (count, 3)) * np.array([1.0, 1.0, 0.75])
