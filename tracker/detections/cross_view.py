"""Detections of several views that may be of one person, grouped on the ground."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from tracker.detections.ground_points import FusionParameters, GroundDetections
from tracker.geometry import Array, Mask


@dataclass(frozen=True, eq=False)
class CrossViewGroup:
    """Boxes of different views that may be one person: members (view, detection), point x, y m, covariance (2, 2) m²."""

    members: tuple[tuple[int, int], ...]
    point: Array
    covariance: Array


def group_across_views(
    views: list[GroundDetections], free: list[Mask], height: tuple[float, float], parameters: FusionParameters
) -> list[CrossViewGroup]:
    """Group the boxes that are `free` in each view, at most one a view, by the Mahalanobis distance of their feet.

    The surest foot starts a group and takes from each other view the nearest within the gate; the point is the covariance-weighted mean.
    Feet that are too likely hidden neither start a group nor join one. Greedy: which groups are people is for the hypotheses to say.
    """
    fit = [np.flatnonzero(free[v] & _standing(f, parameters) & (f.height >= height[0]) & (f.height <= height[1])) for v, f in enumerate(views)]
    view = np.repeat(np.arange(len(views)), [len(rows) for rows in fit])
    if not len(view):
        return []
    box = np.concatenate(fit)
    point = np.concatenate([f.point[rows, :2] for f, rows in zip(views, fit, strict=True)])
    spread = np.concatenate([f.spread[rows] for f, rows in zip(views, fit, strict=True)])
    order = np.lexsort((box, view, np.trace(spread, axis1=1, axis2=2)))
    group, mean, covariance = _grouped(view[order], point[order], spread[order], parameters.gate)
    members: list[list[tuple[int, int]]] = [[] for _ in mean]
    for k, g in zip(order.tolist(), group.tolist(), strict=True):
        members[g].append((int(view[k]), int(box[k])))
    return [CrossViewGroup(tuple(m), x, P) for m, x, P in zip(members, mean, covariance, strict=True)]


def _standing(feet: GroundDetections, parameters: FusionParameters) -> Mask:
    """Whether each box may start somebody: where the place is not sure, one with anything before it, ended above the feet, puts them metres off."""
    variance = np.trace(feet.spread, axis1=1, axis2=2)
    usual = np.where(variance <= parameters.near**2, feet.lying <= parameters.doubtful, ~feet.hidden)
    return feet.grounded & np.where(feet.vague, variance <= parameters.somewhere**2, usual)


@njit(cache=True)
def _grouped(view: NDArray[np.int64], point: Array, spread: Array, gate: float) -> tuple[NDArray[np.int64], Array, Array]:
    """Feet in order, the surest first: view (n,), point (n, 2), spread (n, 2, 2) → group (n,) of each; mean (g, 2), covariance (g, 2, 2)."""
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
