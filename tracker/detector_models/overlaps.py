"""Overlaps of boxes, as edges left, top, right, bottom px, and of people in a view."""

from __future__ import annotations

import numpy as np

from tracker.detector_models.bodies import TrueBodies
from tracker.detector_models.model import OVERLAPS
from tracker.geometry import Array, Ints

MATCH = 0.3
"""Least IoU of a box with the true box, or with its visible part, of the person whom it shows."""


def overlaps(edges: Array) -> Array:
    """Intersection of each two boxes (n, 4) px over the smaller one, (n, n)."""
    low, high = np.maximum(edges[:, None, :2], edges[None, :, :2]), np.minimum(edges[:, None, 2:], edges[None, :, 2:])
    area = np.maximum(np.prod(edges[:, 2:] - edges[:, :2], axis=1), 1e-9)
    return np.asarray(np.prod(np.maximum(high - low, 0.0), axis=2) / np.minimum(area[:, None], area[None]))


def nearest_overlap(bodies: TrueBodies) -> tuple[Ints, Array]:
    """The nearer person (n,) whose box overlaps that of each person most, −1 for none, and the overlap (n,)."""
    if not len(bodies.person):
        return np.zeros(0, dtype=np.int64), np.zeros(0)
    shared = overlaps(bodies.whole)
    shared[bodies.distance[:, None] <= bodies.distance[None]] = 0.0
    other = np.argmax(shared, axis=1)
    most = shared[np.arange(len(other)), other]
    return np.where(most >= OVERLAPS[0], other, -1), most
