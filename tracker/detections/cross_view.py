"""Cross-view association: detections of several views that may be of one person, grouped on the ground."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tracker.detections.ground_points import FusionParameters, GroundDetections
from tracker.geometry import Array, Mask
from tracker.geometry.compilation import njit


@dataclass(frozen=True, eq=False)
class CrossViewGroup:
    """Boxes of different views that may be of one person.

    members: pairs (row of the view, row of the box in it); point (2,) m and covariance (2, 2) m² of the place on the ground.
    """

    members: tuple[tuple[int, int], ...]
    point: Array
    covariance: Array


def group_across_views(
    views: list[GroundDetections], free: list[Mask], height: tuple[float, float], parameters: FusionParameters
) -> list[CrossViewGroup]:
    """Group the boxes that are `free` (n,) in each view, at most one per view, by the Mahalanobis distance of their ground points.

    Points are taken in ascending order of variance. Each point starts a group and takes from each other view the nearest point within the gate.
    The point of a group is the covariance-weighted mean. Boxes whose feet are probably hidden, or whose height (m) is out of bounds, are left out.
    """
    fit = [np.flatnonzero(free[v] & may_initiate(f) & (f.height >= height[0]) & (f.height <= height[1])) for v, f in enumerate(views)]
    view = np.repeat(np.arange(len(views)), [len(rows) for rows in fit])
    if not len(view):
        return []
    box = np.concatenate(fit)
    point = np.concatenate([f.point[rows, :2] for f, rows in zip(views, fit, strict=True)])
    spread = np.concatenate([f.spread[rows] for f, rows in zip(views, fit, strict=True)])
    order = np.lexsort((box, view, np.trace(spread, axis1=1, axis2=2)))
    group, mean, covariance = _group(view[order], point[order], spread[order], parameters.gate)
    members: list[list[tuple[int, int]]] = [[] for _ in mean]
    for k, g in zip(order.tolist(), group.tolist(), strict=True):
        members[g].append((int(view[k]), int(box[k])))
    return [CrossViewGroup(tuple(m), x, P) for m, x, P in zip(members, mean, covariance, strict=True)]


MAX_FEET_HIDDEN = 0.3
"""Boxes whose feet are hidden with a higher probability initiate no track."""

OCCLUDABLE_SIGMA = 0.5
"""m, standard deviation of a place above which a box whose feet may be occluded initiates no track."""

AMBIGUOUS_SIGMA, AMBIGUOUS_SIGMA_KNOWN = 4.0, 10.0
"""m, standard deviation of a place up to which ambiguous boxes initiate tracks; in a known world, far boxes with feet in sight are ambiguous, too."""


def may_initiate(feet: GroundDetections) -> Mask:
    """Which boxes (n,) may initiate a track: where the place is uncertain, a box that ends above the feet misplaces the person by metres."""
    variance = np.trace(feet.spread, axis1=1, axis2=2)
    usual = np.where(variance <= OCCLUDABLE_SIGMA**2, feet.feet_hidden <= MAX_FEET_HIDDEN, ~feet.occludable)
    sigma = AMBIGUOUS_SIGMA_KNOWN if feet.known else AMBIGUOUS_SIGMA
    return feet.grounded & np.where(feet.ambiguous, variance <= sigma**2, usual)


@njit(cache=True)
def _group(view: NDArray[np.int64], point: Array, spread: Array, gate: float) -> tuple[NDArray[np.int64], Array, Array]:
    """Group (n,) of each point, and mean (g, 2) m and covariance (g, 2, 2) m² of each group.

    view (n,), point (n, 2) m, spread (n, 2, 2) m²: the points by ascending variance.
    """
    n, views = len(view), view.max() + 1
    group, mean, covariance, groups = np.full(n, -1), np.empty((n, 2)), np.empty((n, 2, 2)), 0
    for i in range(n):
        if group[i] >= 0:
            continue
        x, P = point[i].copy(), spread[i].copy()
        group[i] = groups
        for v in range(views):
            best, least = -1, gate * gate
            for k in range(i + 1, n):
                if view[k] != v or v == view[i] or group[k] >= 0:
                    continue
                d0, d1 = point[k, 0] - x[0], point[k, 1] - x[1]
                a, b, c = P[0, 0] + spread[k, 0, 0], P[0, 1] + spread[k, 0, 1], P[1, 1] + spread[k, 1, 1]
                distance = (c * d0 * d0 - 2 * b * d0 * d1 + a * d1 * d1) / (a * c - b * b)
                if distance <= least:
                    best, least = k, distance
            if best >= 0:
                K = P @ np.linalg.inv(P + spread[best])
                x += K @ (point[best] - x)
                P = P - K @ P
                group[best] = groups
        mean[groups], covariance[groups], groups = x, P, groups + 1
    return group, mean[:groups], covariance[:groups]
