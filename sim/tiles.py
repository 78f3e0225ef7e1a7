"""Terrain in tiles: the triangles of MuJoCo's height fields, as it draws them, in pieces that can be left out where they are not seen.

Triangles are lit flat, by the normal of their last corner, so that most corners serve several of them.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from tracker.geometry import Array

CELLS = 8
"""Cells along the edge of a tile: smaller tiles are culled better, larger ones cost fewer calls."""

Points = NDArray[np.float32]
Numbers = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Tile:
    """A piece of a height field in the frame of its geom: points and normals (n, 3), triangles (t, 3), box (6,) centre and half edges, m.

    A triangle's own normal is that of its last corner.
    """

    points: Points
    normals: Points
    triangles: Numbers
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
    tiles: list[Tile] = []
    for i in range(0, rows - 1, CELLS):
        for j in range(0, columns - 1, CELLS):
            patch = nodes[i : i + CELLS + 1, j : j + CELLS + 1]
            rims = [(i == 0, patch[0]), (j + CELLS >= columns - 1, patch[:, -1]), (i + CELLS >= rows - 1, patch[-1, ::-1]), (j == 0, patch[::-1, 0])]
            parts = [_surface(patch), *(_skirt(rim, base) for outer, rim in rims if outer)]
            tiles.append(_tile(parts))
    return tiles


def _surface(patch: Points) -> tuple[Points, Numbers]:
    """Nodes (r, c, 3) → points, each node twice, and two triangles a cell, anticlockwise from above, split along (i, j) → (i+1, j+1)."""
    rows, columns = patch.shape[:2]
    number = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]
    # A node is the last corner of two triangles at most: as itself, and as its double.
    triangles = np.stack([np.stack([a, c, d], axis=2), np.stack([c, a, b + rows * columns], axis=2)], axis=2)
    return np.concatenate([patch.reshape(-1, 3)] * 2), triangles.reshape(-1, 3)


def _skirt(rim: Points, base: np.float32) -> tuple[Points, Numbers]:
    """The wall from a rim (n, 3), which goes anticlockwise around the field, down to the solid's bottom."""
    foot = rim.copy()
    foot[:, 2] = -base
    k, n = np.arange(len(rim) - 1), len(rim)
    triangles = np.concatenate([np.stack([n + k + 1, k, k + 1], axis=1), np.stack([k, n + k + 1, n + k], axis=1)])
    return np.concatenate([foot, rim]), triangles[:, [0, 1, 2]]


def _tile(parts: list[tuple[Points, Numbers]]) -> Tile:
    """The parts as one; every triangle's normal goes to its last corner."""
    starts = np.cumsum([0, *(len(points) for points, _ in parts[:-1])])
    points = np.concatenate([points for points, _ in parts])
    triangles = np.concatenate([triangles + start for (_, triangles), start in zip(parts, starts, strict=True)])
    corners = points[triangles]
    facing = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(facing, axis=1, keepdims=True)
    normals = np.zeros_like(points)
    normals[:, 2] = 1.0
    normals[triangles[:, 2]] = facing / np.where(length > 0, length, 1)
    low, high = points.min(axis=0).astype(np.float64), points.max(axis=0).astype(np.float64)
    return Tile(points, normals, triangles, np.concatenate([(low + high) / 2, (high - low) / 2]))
