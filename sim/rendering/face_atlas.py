"""The atlas that faces are drawn into, and the sampling of it: codes of the nearest texels, range between texels of one thing."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

UNIFORM = np.uint32(1 << 31)
"""Marks the code of a texel whose neighbours to the right, above, and both have it too."""


@dataclass(frozen=True, eq=False)
class Atlas:
    """All faces, as they were drawn: colour (height, width, 4); codes, depth (height, width)."""

    colour: NDArray[np.uint8]
    codes: NDArray[np.uint32]
    depth: NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Sampled:
    """What a camera sees: colour (H, W, 3) RGB; range (H, W) m along the ray; values: (H, W) of every table that was looked up."""

    colour: NDArray[np.uint8]
    range: NDArray[np.float32]
    values: tuple[NDArray[Any], ...]


def inverse_depth(near: float, far: float) -> tuple[float, float]:
    """Slope and offset with 1 / planar depth = slope · depth + offset, 1/m, where depth is 1 at `near` and 0 at `far`."""
    return (far - near) / (near * far), 1 / far


def codes_and_ranges(
    atlas: Atlas, table: tuple[NDArray[np.uint32], NDArray[np.uint16], NDArray[np.float32]], limits: tuple[float, float]
) -> tuple[NDArray[np.uint32], NDArray[np.float32]]:
    """The code of the nearest texel and range m, inf where it is 0, of every pixel (H, W).

    table: first, part and stretch of a FaceTable; limits: near and far, m. A code is one geom. Depth is OpenGL's, reversed, and linear in the inverse
    of the planar depth, hence interpolated as it is, which is exact on planes, where the four neighbours are of one geom; the nearest elsewhere.
    """
    tags, seen = np.empty(atlas.codes.shape, np.uint32), np.empty(table[0].shape, np.uint32)
    _mark_uniform(atlas.codes, tags)
    return seen, _ranges((tags, atlas.depth), table, np.array(inverse_depth(*limits), np.float32), seen)


@numba.njit(cache=True)
def _mark_uniform(codes, out):  # type: ignore[no-untyped-def]
    """Writes the codes (height, width) into `out`, with EVEN set where the neighbours to the right, above, and both share a texel's code."""
    flat, tags, pitch = codes.ravel(), out.ravel(), codes.shape[1]
    for k in range(flat.size - pitch - 1):
        code = flat[k]
        other = (flat[k + 1] ^ code) | (flat[k + pitch] ^ code) | (flat[k + pitch + 1] ^ code)
        tags[k] = code | (UNIFORM if other == 0 else np.uint32(0))
    # The last have no such neighbours.
    for k in range(max(flat.size - pitch - 1, 0), flat.size):
        tags[k] = flat[k]


@numba.njit(cache=True, error_model="numpy")
def _ranges(atlas, table, inverse, seen):  # type: ignore[no-untyped-def]
    """Fills in the codes that are seen (H, W); returns range (H, W). Unsigned indices need no look at their sign."""
    tags, depth = atlas[0].ravel(), atlas[1].ravel()
    first, fraction, range_per_depth = table
    pitch, one, half = np.uint64(atlas[0].shape[1]), np.uint64(1), np.uint32(15)
    height, width = first.shape
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
            seen[i, j] = code
            distance[i, j] = range_per_depth[i, j] / (slope * deep + offset) if code else np.float32(np.inf)
    return distance
