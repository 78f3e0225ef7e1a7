"""Windows of a panorama: rectangles of whole pixels [u0, v0, u1, v1] with u0 in [0, W) and u1 ≤ u0 + W, beyond W where they go over the seam."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tracker.cameras import Panorama
from tracker.geometry import Array, angles_from_bearing, wrap

Window = NDArray[np.int64]


def around(centres: Array, radii: Array, camera: Panorama) -> Window:
    """The window that holds every pixel whose ray meets one of the balls (n, 3), (n,) m in the camera's frame, and some more; empty for n = 0."""
    if not len(centres):
        return np.zeros(4, np.int64)
    distance = np.linalg.norm(centres, axis=1)
    azimuth, elevation = angles_from_bearing(centres)
    inside = distance <= radii
    reach = np.where(inside, np.pi, np.arcsin(np.where(inside, 0.0, radii / np.maximum(distance, 1e-9))))
    # A ball of angular radius ρ at elevation e spans asin(sin ρ / cos e) of azimuth to each side, and all of it once it holds a pole.
    pole = np.abs(elevation) + reach >= np.pi / 2
    aside = np.where(pole, np.pi, np.arcsin(np.where(pole, 0.0, np.sin(reach) / np.maximum(np.cos(elevation), 1e-9))))
    turned = wrap(azimuth - azimuth[0])
    left, right = azimuth[0] + (turned + aside).max(), azimuth[0] + (turned - aside).min()
    per_radian = camera.width / (2 * np.pi)
    u0, u1 = np.floor((np.pi - left) * per_radian) - 1, np.ceil((np.pi - right) * per_radian) + 1
    v0 = np.floor((np.pi / 2 - (elevation + reach).max()) * per_radian) - 1
    v1 = np.ceil((np.pi / 2 - (elevation - reach).min()) * per_radian) + 1
    span = min(u1 - u0, camera.width)
    start = 0 if span == camera.width else u0 % camera.width
    return np.array([start, max(v0, 0), start + span, min(v1, camera.height)], dtype=np.int64)


def apart(a: Window, b: Window, width: int) -> bool:
    """Whether two windows of a panorama of that width share no pixel."""
    if a[3] <= b[1] or b[3] <= a[1]:
        return True
    gap_after_a, gap_after_b = (b[0] - a[0]) % width - (a[2] - a[0]), (a[0] - b[0]) % width - (b[2] - b[0])
    return bool(gap_after_a >= 0 and gap_after_b >= 0)


def layers(windows: list[Window], width: int) -> list[list[int]]:
    """The windows' indices, dealt greedily into few layers within which no two windows share a pixel."""
    dealt: list[list[int]] = []
    for k, window in enumerate(windows):
        for layer in dealt:
            if all(apart(window, windows[other], width) for other in layer):
                layer.append(k)
                break
        else:
            dealt.append([k])
    return dealt


def columns(window: Window, width: int) -> NDArray[np.int64]:
    """The columns of a window, from left to right."""
    return np.asarray(np.arange(window[0], window[2]) % width)


def tight(mask: NDArray[np.bool_], window: Window, width: int) -> Array:
    """The smallest window (4,) as floats around what is set in `mask`, which covers `window`; NaN where nothing is.

    Where the mask goes all around, the window starts after the widest gap.
    """
    rows, across = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    if not len(rows):
        return np.full(4, np.nan)
    first, last = across[0], across[-1] + 1
    if window[2] - window[0] == width:
        gaps = np.diff(across, append=across[0] + width)
        widest = len(gaps) - 1 - int(np.argmax(gaps[::-1]))
        first = across[(widest + 1) % len(across)]
        last = first + width - gaps[widest] + 1
    u0 = (window[0] + first) % width
    return np.array([u0, window[1] + rows[0], u0 + last - first, window[1] + rows[-1] + 1], dtype=np.float64)
