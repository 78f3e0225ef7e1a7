"""Terrain in tiles: the triangles of MuJoCo's height fields, as it draws them, in pieces that can be left out where they are not seen.

MuJoCo draws a height field as a whole, three times a face: most of the time of a panorama, were it not cut up.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from tracker.geometry import Array

CELLS = 24
"""Cells along the edge of a tile: smaller tiles are culled better, larger ones cost fewer calls."""

Triangles = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Tile:
    """A piece of a height field in the frame of its geom: corners and normals (t, 3, 3) of triangles, box (6,) centre and half edges, m."""

    corners: Triangles
    normals: Triangles
    box: Array


def tiles_of(model: mujoco.MjModel, hfield: int) -> list[Tile]:
    """The height field of that number, without the bottom of its solid."""
    rows, columns, start = model.hfield_nrow[hfield], model.hfield_ncol[hfield], model.hfield_adr[hfield]
    width, depth, height, base = model.hfield_size[hfield].astype(np.float32)
    heights = model.hfield_data[start : start + rows * columns].reshape(rows, columns) * height
    half = np.array([columns - 1, rows - 1], np.float32) / 2
    x = width * (np.arange(columns, dtype=np.float32) / half[0] - 1)
    y = depth * (np.arange(rows, dtype=np.float32) / half[1] - 1)
    nodes = np.stack([*np.meshgrid(x, y), heights], axis=-1).astype(np.float32)
    tiles = []
    for i in range(0, rows - 1, CELLS):
        for j in range(0, columns - 1, CELLS):
            patch = nodes[i : i + CELLS + 1, j : j + CELLS + 1]
            rims = [(i == 0, patch[0]), (j + CELLS >= columns - 1, patch[:, -1]), (i + CELLS >= rows - 1, patch[-1, ::-1]), (j == 0, patch[::-1, 0])]
            parts = [_surface(patch), *(_skirt(rim, base) for outer, rim in rims if outer)]
            tiles.append(_tile(np.concatenate(parts)))
    return tiles


def _surface(patch: Triangles) -> Triangles:
    """Nodes (r, c, 3) → two triangles a cell, anticlockwise from above, split along (i, j) → (i+1, j+1)."""
    a, b, c, d = patch[:-1, :-1], patch[:-1, 1:], patch[1:, 1:], patch[1:, :-1]
    return np.stack([np.stack([d, a, c], axis=2), np.stack([a, b, c], axis=2)], axis=2).reshape(-1, 3, 3)


def _skirt(rim: Triangles, base: np.float32) -> Triangles:
    """The wall (t, 3, 3) from a rim (n, 3), which goes anticlockwise around the field, down to the solid's bottom."""
    foot = rim.copy()
    foot[:, 2] = -base
    a, b, c, d = foot[:-1], foot[1:], rim[1:], rim[:-1]
    return np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])


def _tile(corners: Triangles) -> Tile:
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    normals = normals / np.where(length > 0, length, 1)
    low, high = corners.min(axis=(0, 1)).astype(np.float64), corners.max(axis=(0, 1)).astype(np.float64)
    repeated = np.ascontiguousarray(np.broadcast_to(normals[:, None], corners.shape), dtype=np.float32)
    return Tile(corners, repeated, np.concatenate([(low + high) / 2, (high - low) / 2]))
