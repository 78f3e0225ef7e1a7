"""Surfaces of revolution with texture coordinates, and the surfaces that stand for cloth."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from worlds.props.shapes import SIDES, Shape
from worlds.textures.furniture_atlas import Surface, crop

CLOTHES = (Surface.BLUE, Surface.RED, Surface.GREEN, Surface.DARK, Surface.STEEL, Surface.WALNUT, Surface.WHITE)


def revolved(rng: np.random.Generator, surface: Surface, profile: ArrayLike, flat: float = 1.0) -> Shape:
    """A surface of revolution about z. profile: (k, 2) m of radius and height, upwards; flat: depth along y, as a share of the width."""
    rows = np.asarray(profile, dtype=np.float64)
    angle = np.linspace(-np.pi, np.pi, SIDES + 1)
    ring = np.stack([np.cos(angle), flat * np.sin(angle)], axis=1)
    low, high = rows[0, 1], rows[-1, 1]
    (u0, v0), (u1, v1) = crop(rng, surface, (2 * np.pi * float(rows[:, 0].max()), float(high - low)))
    vertices = np.concatenate([np.column_stack([radius * ring, np.full(len(ring), z)]) for radius, z in rows])
    share = (rows[:, 1] - low) / (high - low)
    texcoord = np.stack(np.broadcast_arrays(np.linspace(u0, u1, SIDES + 1), v1 + (v0 - v1) * share[:, None]), axis=-1).reshape(-1, 2)
    i, j = (n.ravel() for n in np.mgrid[: len(rows) - 1, :SIDES])
    a = i * (SIDES + 1) + j
    b, c, d = a + 1, a + SIDES + 2, a + SIDES + 1
    return Shape(vertices, np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)]), texcoord)
