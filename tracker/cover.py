"""How much of somebody things and other people lie over, as a camera sees it, by drawing bodies as upright rectangles."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from tracker.geometry import Array

Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]

HALF, TALL = 0.3, 1.75
"""m: half the width of the box that a body fills, and its height ..."""
SLIM = 0.22
"""... and half the width over which a body hides what is behind it."""
ACROSS, UP = 9, 15
"""Points of a box that are looked at."""
BEFORE = 0.15
"""m, by which what hides somebody is nearer."""


@njit(cache=True)
def covered(origin: Array, place: Array, tree: Ints, front: Ints, pillars: Array) -> Array:
    """Share (n, 2) of the boxes of people who stand at `place` (n, 3) m, seen from `origin` (3,) m, that `pillars` (p, 5; as in Setup) lie over, and
    that the people in the rows `front` do who are of another tree (n,)."""
    n, p = len(place), len(pillars)
    out, hidden = np.zeros((n, 2)), np.empty((UP, ACROSS), np.bool_)
    things = np.empty((p + len(front), 5))
    for j in range(p):
        things[j] = _seen(origin, pillars[j, 0], pillars[j, 1], pillars[j, 2], pillars[j, 3], pillars[j, 4])
    for j in range(len(front)):
        x, y, z = place[front[j]]
        things[p + j] = _seen(origin, x, y, SLIM, z, z + TALL)
    for i in range(n):
        x, y, z = place[i]
        body = _seen(origin, x, y, HALF, z, z + TALL)
        hidden[:] = False
        some = False
        for j in range(len(things)):
            if j == p and some:
                out[i, 0] = hidden.mean()
                hidden[:] = False
                some = False
            if j < p or tree[front[j - p]] != tree[i]:
                some |= _draw(things[j], body, hidden)
        if some:
            out[i, 0 if len(things) == p else 1] = hidden.mean()
    return out


@njit(cache=True)
def _seen(origin: Array, x: float, y: float, half: float, low: float, high: float) -> Array:
    """(5,): distance m, azimuth and half the width in rad, and tangents of the elevations of the lower and the upper edge."""
    dx, dy = x - origin[0], y - origin[1]
    far = max(math.hypot(dx, dy), 0.1)
    return np.array([far, math.atan2(dy, dx), math.atan2(half, far), (low - origin[2]) / far, (high - origin[2]) / far])


@njit(cache=True)
def _draw(thing: Array, body: Array, hidden: Mask) -> bool:
    """Mark the points of `body` that `thing` lies over, in place; whether it may lie over any."""
    apart = thing[1] - body[1]
    apart -= 2 * math.pi * math.floor(apart / (2 * math.pi) + 0.5)
    if thing[0] > body[0] - BEFORE or abs(apart) >= body[2] + thing[2]:
        return False
    for row in range(UP):
        if thing[3] < body[3] + (body[4] - body[3]) * (row + 0.5) / UP < thing[4]:
            for column in range(ACROSS):
                hidden[row, column] |= abs(body[2] * (2 * (column + 0.5) / ACROSS - 1) - apart) < thing[2]
    return True
