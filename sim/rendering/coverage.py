"""Unoccluded extents of single bodies: pixel counts and boxes, decoded from a buffer with one bit per body."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tracker.geometry import Array
from tracker.geometry.compilation import njit

BITS = 32
"""Bodies that one buffer of 32-bit texels can hold."""


@dataclass(frozen=True, eq=False)
class UnoccludedExtent:
    """The pixels that one instance would cover if nothing occluded it (its amodal mask).

    pixels: their number. box (4,): u0, v0, u1, v1 px around them; NaN where no pixel is covered.
    In a panorama u0 is in [0, W) and u1 in (u0, u0 + W]: a box across the seam has u1 > W.
    """

    pixels: int
    box: Array


def covered(slot_bits: NDArray[np.uint32], nearest: NDArray[np.int32], count: int, wraps: bool) -> list[UnoccludedExtent]:
    """Extents of `count` ≤ BITS bodies. nearest (H, W): flat texel index of every pixel; wraps: whether the image is a full panorama."""
    pixels, rows, columns = _count(slot_bits.ravel(), nearest, count)
    return [UnoccludedExtent(int(pixels[k]), bounding_box(rows[k], columns[k], wraps)) for k in range(count)]


def bounding_box(rows: NDArray[np.int64], columns: NDArray[np.bool_], wraps: bool) -> Array:
    """The smallest box (4,) from the first and last row (2,) and the used columns (W,). In a panorama it starts after the widest gap."""
    across = np.flatnonzero(columns)
    if not len(across):
        return np.full(4, np.nan)
    first, last = int(across[0]), int(across[-1]) + 1
    if wraps:
        width = len(columns)
        gaps = np.diff(across, append=across[0] + width)
        widest = len(gaps) - 1 - int(np.argmax(gaps[::-1]))
        first = int(across[(widest + 1) % len(across)])
        last = first + width - int(gaps[widest]) + 1
    return np.array([first, rows[0], last, rows[1] + 1], dtype=np.float64)


@njit(cache=True)
def _count(slot_bits, nearest, count):  # type: ignore[no-untyped-def]
    height, width = nearest.shape
    pixels = np.zeros(count, np.int64)
    rows = np.zeros((count, 2), np.int64)
    columns = np.zeros((count, width), np.bool_)
    for i in range(height):
        for j in range(width):
            left = slot_bits[nearest[i, j]]
            k = 0
            while left:
                if left & np.uint32(1):
                    if pixels[k] == 0:
                        rows[k, 0] = i
                    rows[k, 1] = i
                    pixels[k] += 1
                    columns[k, j] = True
                left >>= np.uint32(1)
                k += 1
    return pixels, rows, columns
