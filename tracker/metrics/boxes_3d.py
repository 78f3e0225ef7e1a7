"""Upright 3-D boxes of people, their intersection over union, and HOTA on it, as track 1 of the AI City Challenge is scored.

A box is x, y, z of its middle (m), width, length, height (m) and yaw (rad). The width lies along the box's own x axis, the length along its y axis.
Yaw turns that x axis anticlockwise from the world's. The challenge (https://www.aicitychallenge.org/2026-track1/, read in 2026) scores by
HOTA with the intersection over union of the boxes as similarity, at the thresholds α = 0.05, 0.10, …, 0.95.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tracker.geometry import Array
from tracker.metrics.hota import HotaSums, hota_sums
from tracker.metrics.matching import MatchingFrame, compare, match_frames, planar_distance, without_ignored

BOX = 7
"""Columns of a box: x, y, z, width, length, height, yaw."""
EPSILON = 1e-12
"""m²: corners this far outside an edge, as the cross product with the edge, count as inside."""


def overlap_3d(truth: Array, estimate: Array) -> Array:
    """Boxes (m, 7), (k, 7) → intersection over union of their volumes (m, k).

    The volumes are upright prisms: the footprints intersect in a convex polygon of exact area, the heights in an interval.
    Raises ValueError for other than seven columns, and for a size that is not above 0.
    """
    for name, boxes in (("truth", truth), ("estimate", estimate)):
        if len(boxes) and (boxes.shape[1] != BOX or not (boxes[:, 3:6] > 0).all()):
            raise ValueError(f"{name} boxes of shape {boxes.shape} need ({len(boxes)}, {BOX}) and sizes above 0")
    out = np.zeros((len(truth), len(estimate)))
    if not out.size:
        return out
    reach = [np.hypot(boxes[:, 3], boxes[:, 4]) / 2 for boxes in (truth, estimate)]
    low = np.maximum((truth[:, 2] - truth[:, 5] / 2)[:, None], (estimate[:, 2] - estimate[:, 5] / 2)[None])
    high = np.minimum((truth[:, 2] + truth[:, 5] / 2)[:, None], (estimate[:, 2] + estimate[:, 5] / 2)[None])
    rows, columns = np.nonzero((planar_distance(truth, estimate) < reach[0][:, None] + reach[1][None]) & (high > low))
    if len(rows):
        one, other = truth[rows], estimate[columns]
        # Coordinates from the middle of the first box keep the precision far from the origin.
        shared = intersection_area(_corners(one, one[:, :2]), _corners(other, one[:, :2])) * (high - low)[rows, columns]
        out[rows, columns] = shared / (one[:, 3:6].prod(axis=1) + other[:, 3:6].prod(axis=1) - shared)
    return out


def _corners(boxes: Array, origin: Array) -> Array:
    """The footprints (n, 4, 2) of boxes (n, 7), anticlockwise, relative to `origin` (n, 2)."""
    half = boxes[:, None, 3:5] / 2 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    c, s = np.cos(boxes[:, 6])[:, None], np.sin(boxes[:, 6])[:, None]
    turned = np.stack([c * half[..., 0] - s * half[..., 1], s * half[..., 0] + c * half[..., 1]], axis=2)
    return np.asarray(turned + (boxes[:, :2] - origin)[:, None])


def _cross(a: Array, b: Array) -> Array:
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])


def intersection_area(one: Array, other: Array) -> Array:
    """Areas (n,) m² of the intersections of convex polygons (n, p, 2), (n, q, 2) m with their corners anticlockwise.

    The corners of an intersection are the corners of either polygon in the other and the crossings of their edges. Their order about
    the mean gives the area by the shoelace formula.
    """
    edge, edge_other = (np.roll(polygon, -1, axis=1) - polygon for polygon in (one, other))

    def within(points: Array, polygon: Array, edges: Array) -> Array:
        return np.asarray((_cross(edges[:, None], points[:, :, None] - polygon[:, None]) >= -EPSILON).all(axis=2))

    apart = other[:, None] - one[:, :, None]
    turn = _cross(edge[:, :, None], edge_other[:, None])
    parallel = np.abs(turn) < EPSILON
    along, along_other = (_cross(apart, e) / np.where(parallel, 1.0, turn) for e in (edge_other[:, None], edge[:, :, None]))
    crosses = ~parallel & (along >= 0) & (along <= 1) & (along_other >= 0) & (along_other <= 1)
    crossings = one[:, :, None] + along[..., None] * edge[:, :, None]
    n = len(one)
    points = np.concatenate([one, other, crossings.reshape(n, -1, 2)], axis=1)
    valid = np.concatenate([within(one, other, edge_other), within(other, one, edge), crosses.reshape(n, -1)], axis=1)
    mean = (points * valid[..., None]).sum(axis=1) / np.maximum(1, valid.sum(axis=1))[:, None]
    points = points - mean[:, None]
    order = np.argsort(np.where(valid, np.arctan2(points[..., 1], points[..., 0]), np.inf), axis=1)
    ring, kept = np.take_along_axis(points, order[..., None], axis=1), np.take_along_axis(valid, order, axis=1)
    # Points that are no corners repeat the first corner, so that they add no area.
    ring = np.where(kept[..., None], ring, np.where(kept[:, :1, None], ring[:, :1], 0.0))
    return np.asarray(_cross(ring, np.roll(ring, -1, axis=1)).sum(axis=1) / 2)


def hota_3d(frames: Sequence[MatchingFrame]) -> HotaSums:
    """HOTA with overlap_3d as similarity; the positions of `frames` are boxes (m, 7), (k, 7).

    People that are not evaluated are removed with the estimates within 1 m that are matched to them, as in clear_mot.
    Raises ValueError as overlap_3d, and for an id twice in a frame.
    """
    overlaps = compare(frames, overlap_3d)
    if any(frame.counts is not None for frame in frames):
        near = compare(frames, planar_distance).mapped(lambda d: np.maximum(0.0, 1 - d / 2))
        overlaps = without_ignored(frames, overlaps, match_frames(near, 0.5))
    return hota_sums(overlaps)
