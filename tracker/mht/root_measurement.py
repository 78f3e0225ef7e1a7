"""Roots of new track trees: groups of unassigned boxes, and the places and statures that these boxes measure."""

from __future__ import annotations

from typing import Any

import numpy as np

from tracker.detections.cross_view import CrossViewGroup
from tracker.detections.ground_points import GroundDetections
from tracker.detections.walkable_prior import WalkablePrior
from tracker.geometry import Array
from tracker.geometry.compilation import njit
from tracker.geometry.ground import Ground
from tracker.mht.box_update import PREDICTED, head_of, predict_measurement, update_by_head
from tracker.mht.branching_data import Observation, ParentHypotheses
from tracker.mht.track_trees import TrackHypotheses
from tracker.tracks.tracks import Places, with_places

CERTAIN_PRIOR = 0.99
"""Expectation of the walkable prior at and above which a track stays unchanged."""


def with_statures(roots: TrackHypotheses, groups: list[CrossViewGroup], now: Observation, ground: Ground) -> None:
    """Update the roots (g,), in place, by the upper edges of their boxes; without any, by the range likelihood of an ambiguous box."""
    n, views = len(roots), now.views
    if all(feet.ranges is None for feet in views) or not n:
        return
    parents = ParentHypotheses.of(roots, ground, np.zeros((n, len(views))), np.zeros((n, 0)))
    for k, group in enumerate(groups):
        usable = [(v, d) for v, d in group.members if views[v].known and not views[v].ambiguous[d] and not views[v].cut[d]]
        for v, d in usable:
            _measure_stature(k, v, now.table.start[v] + d, parents, now.table, now.limits)
        v, d = group.members[0]
        if not usable and views[v].ambiguous[d]:
            _along_ray(roots.state[k], roots.covariance[k], views[v], d)


@njit(cache=True)
def _measure_stature(k: int, v: int, d: int, parents: Any, boxes: Any, limits: Any) -> None:
    """Update the root k, in place, by the upper edge of box d of view v."""
    predicted, x, P = np.empty(PREDICTED), parents.state[k], parents.covariance[k]
    predict_measurement(x, k, parents, v, boxes, predicted)
    head = head_of(predicted, x, P, v, d, boxes)
    if head.above * head.above < limits.gate**2 * head.spread:
        update_by_head(x, P, head, x.copy())


def _along_ray(x: Array, P: Array, feet: GroundDetections, d: int) -> None:
    """Set the stature of x (5,), P (5, 5) and its correlation with the place, in place, by the range likelihood of ambiguous box d."""
    assert feet.ranges is not None
    u = feet.direction[d, :2] / np.hypot(*feet.direction[d, :2])
    (mean,), (range_covariance,) = feet.ranges.initial(np.array([d]))
    slope = range_covariance[0, 1] / range_covariance[0, 0]
    x[4] = mean[1] + slope * (u @ (x[:2] - feet.origin[:2]) - mean[0])
    P[:2, 4] = P[4, :2] = slope * P[:2, :2] @ u
    P[4, 4] = range_covariance[1, 1] - slope * range_covariance[0, 1] + slope**2 * u @ P[:2, :2] @ u


def with_walkable_prior(prior: WalkablePrior | None, state: Array, covariance: Array) -> tuple[Array, Array, Array]:
    """States (n, 5) and covariances (n, 5, 5) with their places weighted by the prior of walkable places, and its log-likelihood (n,)."""
    if prior is None or not len(state):
        return state, covariance, np.zeros(len(state))
    place, variance = state[:, :2], covariance[:, :2, :2]
    mean, spread, expected = prior.posterior(place, variance)
    rows = np.flatnonzero(expected < CERTAIN_PRIOR)
    out = with_places(state, covariance, rows, Places(place[rows], variance[rows]), Places(mean[rows], spread[rows]))
    return *out, np.log(np.where(expected < CERTAIN_PRIOR, expected, 1.0))
