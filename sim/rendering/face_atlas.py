"""Atlas of rendered faces, and its sampling: code of the nearest texel, range interpolated within one geom."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tracker.geometry.compilation import njit

UNIFORM = np.uint32(1 << 31)
"""Bit that marks a texel whose right, upper and upper right neighbours have the same code."""


@dataclass(frozen=True, eq=False)
class Atlas:
    """All rendered faces: colour (height, width, 4); codes, depth (height, width)."""

    colour: NDArray[np.uint8]
    codes: NDArray[np.uint32]
    depth: NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Sampled:
    """Sampled image of a camera: colour (H, W, 3) RGB; range (H, W) m along the ray; values: (H, W) for every lookup table."""

    colour: NDArray[np.uint8]
    range: NDArray[np.float32]
    values: tuple[NDArray[Any], ...]


def inverse_depth(near: float, far: float) -> tuple[float, float]:
    """Slope and offset, 1/m, of 1 / planar depth = slope · depth + offset, where depth is 1 at `near` and 0 at `far`."""
    return (far - near) / (near * far), 1 / far


def values_and_ranges(
    atlas: Atlas,
    table: tuple[NDArray[np.uint32], NDArray[np.uint16], NDArray[np.float32]],
    limits: tuple[float, float],
    lookups: Sequence[NDArray[Any]],
) -> tuple[tuple[NDArray[Any], ...], NDArray[np.float32]]:
    """Values of the nearest texel's code by one or two lookup tables (codes,), and range in m (inf where the code is 0), of every pixel (H, W).

    table: first, fraction and range_per_depth of a FaceTable. limits: near and far plane, m.
    Depth is interpolated bilinearly where the four neighbours have one code, which is exact on planes. Elsewhere the nearest texel counts.
    Raises ValueError for another number of lookup tables.
    """
    if not 1 <= len(lookups) <= 2:
        raise ValueError(f"there are {len(lookups)} lookup tables, needs 1 or 2")
    tags, shape = np.empty(atlas.codes.shape, np.uint32), table[0].shape
    _mark_uniform(atlas.codes, tags)
    values = tuple(np.empty(shape, lookup.dtype) for lookup in lookups)
    # The second table is empty where there is one, so that one kernel serves both.
    none = np.empty((0, 0), np.uint8)
    second = (lookups[1], values[1]) if len(lookups) == 2 else (none.ravel(), none)
    inverse = np.array(inverse_depth(*limits), np.float32)
    return values, _sampled((tags, atlas.depth), table, inverse, (lookups[0], second[0]), (values[0], second[1]))


@njit(cache=True)
def _mark_uniform(codes, out):  # type: ignore[no-untyped-def]
    """Write the codes (height, width) into `out`, with UNIFORM set where the right, upper and upper right neighbours share the code."""
    flat, tags, pitch = codes.ravel(), out.ravel(), codes.shape[1]
    for k in range(flat.size - pitch - 1):
        code = flat[k]
        other = (flat[k + 1] ^ code) | (flat[k + pitch] ^ code) | (flat[k + pitch + 1] ^ code)
        tags[k] = code | (UNIFORM if other == 0 else np.uint32(0))
    # The last texels have no such neighbours.
    for k in range(max(flat.size - pitch - 1, 0), flat.size):
        tags[k] = flat[k]


@njit(cache=True, error_model="numpy")
def _sampled(atlas, table, inverse, lookups, values):  # type: ignore[no-untyped-def]
    """Fill in the values of the pixels (H, W) and return their range (H, W). Unsigned indices skip numba's test for negative ones."""
    tags, depth = atlas[0].ravel(), atlas[1].ravel()
    first, fraction, range_per_depth = table
    pitch, one, half = np.uint64(atlas[0].shape[1]), np.uint64(1), np.uint32(15)
    height, width = first.shape
    two = values[1].size > 0
    distance = np.empty((height, width), np.float32)
    slope, offset, whole = inverse[0], inverse[1], np.float32(1 / 65536)
    for i in range(height):
        for j in range(width):
            at, a, b = np.uint64(first[i, j]), np.uint32(fraction[i, j, 0]), np.uint32(fraction[i, j, 1])
            code = tags[at]
            if code > UNIFORM:
                c, e = depth[at], depth[at + pitch]
                across = whole * np.float32(a)
                bottom, top = c + across * (depth[at + one] - c), e + across * (depth[at + pitch + one] - e)
                deep = bottom + whole * np.float32(b) * (top - bottom)
            else:
                near = at + np.uint64(a >> half) + pitch * np.uint64(b >> half)
                code, deep = tags[near], depth[near]
            code &= ~UNIFORM
            values[0][i, j] = lookups[0][np.uint64(code)]
            if two:
                values[1][i, j] = lookups[1][np.uint64(code)]
            distance[i, j] = range_per_depth[i, j] / (slope * deep + offset) if code else np.float32(np.inf)
    return distance
