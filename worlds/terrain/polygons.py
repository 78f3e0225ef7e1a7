"""Polygons in the plane: point tests, distances, and rotated rectangles."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from worlds.terrain.heightfield import Array, Heightfield, Mask


def rectangle(centre: ArrayLike, size: ArrayLike, yaw: float = 0.0) -> Array:
    """Corners (4, 2) m, anticlockwise, of a rectangle of size (length, width) m whose length points along yaw, radians."""
    half = np.asarray(size, dtype=np.float64) / 2
    corners = half * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    return turned(corners, yaw) + np.asarray(centre, dtype=np.float64)


def turned(points: ArrayLike, yaw: float) -> Array:
    """Points (..., 2) turned by yaw radians about the origin."""
    c, s = np.cos(yaw), np.sin(yaw)
    return np.asarray(points, dtype=np.float64) @ np.array([[c, s], [-s, c]])


def signed_distance(points: ArrayLike, corners: ArrayLike) -> Array:
    """Points (..., 2) m → (...) m to the edge of a simple polygon (k, 2), negative inside (by the even-odd rule)."""
    p, a = np.asarray(points, dtype=np.float64), np.asarray(corners, dtype=np.float64)
    nearest = np.full(p.shape[:-1], np.inf)
    inside = np.zeros(p.shape[:-1], dtype=bool)
    for start, end in zip(a, np.roll(a, -1, axis=0), strict=True):
        edge, offset = end - start, p - start
        along = np.clip((offset @ edge) / max(float(edge @ edge), 1e-12), 0.0, 1.0)
        nearest = np.minimum(nearest, np.hypot(offset[..., 0] - along * edge[0], offset[..., 1] - along * edge[1]))
        crosses = (start[1] > p[..., 1]) != (end[1] > p[..., 1])
        if crosses.any():
            inside ^= crosses & (offset[..., 0] < offset[..., 1] * edge[0] / (edge[1] if edge[1] else 1.0))
    return np.where(inside, -nearest, nearest)


def offset(corners: ArrayLike, distance: float) -> Array:
    """A polygon (k, 2), anticlockwise, with every edge moved outwards by `distance` m and the corners mitred."""
    a = np.asarray(corners, dtype=np.float64)
    edge = np.roll(a, -1, axis=0) - a
    outward = np.stack([edge[:, 1], -edge[:, 0]], axis=1) / np.hypot(*edge.T)[:, None]
    before = np.roll(outward, 1, axis=0)
    return a + distance * (before + outward) / (1 + (before * outward).sum(axis=1, keepdims=True))


def covered(ground: Heightfield, corners: ArrayLike, margin: float = 0.0) -> Mask:
    """Mask (rows, columns) of grid points of the ground that lie in a polygon (k, 2) m or at most `margin` m off it."""
    mask = np.zeros(ground.heights.shape, dtype=bool)
    a = np.asarray(corners, dtype=np.float64)
    low = np.maximum(np.floor((a.min(axis=0) - margin - ground.origin) / ground.spacing), 0).astype(np.int64)
    high = np.maximum(np.ceil((a.max(axis=0) + margin - ground.origin) / ground.spacing) + 1, 0).astype(np.int64)
    window = mask[low[1] : high[1], low[0] : high[0]]
    y, x = ground.y[low[1] : high[1]], ground.x[low[0] : high[0]]
    if window.size:
        window[:] = signed_distance(np.stack(np.meshgrid(x, y), axis=-1), a) <= margin
    return mask
