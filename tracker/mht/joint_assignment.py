"""Joint assignment of boxes to the leaves of one global hypothesis, one 2-D assignment per view."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
from scipy.optimize import linear_sum_assignment

from tracker.geometry import Array, Ints, Mask
from tracker.geometry.compilation import njit
from tracker.mht.box_update import PREDICTED, log_likelihood, predict_measurement, update_child
from tracker.mht.branching import MAX_GATED, child_ratios, gate, view_order
from tracker.mht.branching_data import BoxTable, BranchingConstants, ChildHypotheses, ParentHypotheses, empty_children

NO_ALTERNATIVE = 50.0
"""Log-likelihood ratio of a box over none, where every child of a leaf takes a box of that view."""


def assign_jointly(rows: Ints, parents: ParentHypotheses, boxes: BoxTable, limits: BranchingConstants) -> ChildHypotheses:
    """One child for each leaf in `rows` (k,) of a global hypothesis, by a 2-D assignment of boxes to leaves in one view after another.

    Children that are found leaf by leaf are rarely compatible where people stand close together in many views.
    """
    k, V = len(rows), len(boxes.origin)
    out = ChildHypotheses(*empty_children(k, V))
    out.parent[:] = rows
    out.state[:], out.covariance[:] = parents.state[rows], parents.covariance[rows]
    for v in _joint_view_order(rows, parents, boxes):
        over_none = np.maximum(_pairwise_ratios(v, rows, parents, boxes, limits, out) - parents.missed[rows, v, None], 0.0)
        i, d = _assign(over_none)
        box = np.full(k, -1)
        box[i] = d + boxes.start[v]
        _update_all(v, box, parents, boxes, limits, out)
    return out


def assigned_boxes(rows: Ints, children: ChildHypotheses, boxes: BoxTable) -> Mask:
    """Which boxes (D,) the leaves in `rows` take: a 2-D assignment in each view, by the best child of each leaf with each box."""
    place = np.full(max(children.parent.max(initial=-1), rows.max(initial=-1)) + 1, -1)
    place[rows] = np.arange(len(rows))
    mine = place[children.parent] >= 0
    row, box, increment = place[children.parent[mine]], children.box[mine], children.increment[mine]
    out = np.zeros(len(boxes.cut), dtype=bool)
    for v, (start, end) in enumerate(itertools.pairwise(boxes.start.tolist())):
        best = np.full((len(rows), end - start + 1), -np.inf)
        np.maximum.at(best, (row, np.where(box[:, v] >= 0, box[:, v] - start, -1)), increment)
        # Where every child of a leaf takes a box of this view, the leaf takes one of these boxes.
        none = np.maximum(best[:, -1:], best.max(axis=1, keepdims=True) - NO_ALTERNATIVE)
        out[start + _assign(np.maximum(best[:, :-1] - none, 0.0))[1]] = True
    return out


def union(children: ChildHypotheses, others: ChildHypotheses) -> ChildHypotheses:
    """`children` and those of `others` with a box that are not among them, in the order of ChildHypotheses."""
    known = {(p, *b) for p, b in zip(children.parent.tolist(), children.box.tolist(), strict=True)}
    found = [(p, *b) not in known and max(b, default=-1) >= 0 for p, b in zip(others.parent.tolist(), others.box.tolist(), strict=True)]
    new = np.flatnonzero(found)
    if not len(new):
        return children
    both = ChildHypotheses._make(np.concatenate([a, b[new]]) for a, b in zip(children, others, strict=True))
    rows = np.lexsort((-both.increment, (both.box < 0).all(axis=1), both.parent))
    return ChildHypotheses._make(column[rows] for column in both)


def _assign(ratio: Array) -> tuple[Ints, Ints]:
    """Rows and columns (m,) of the assignment of the largest sum; ratio (k, d) of each box over none, 0 where it is not taken."""
    rows, boxes = linear_sum_assignment(ratio, maximize=True)
    taken = ratio[rows, boxes] > 0
    return rows[taken], boxes[taken]


@njit(cache=True)
def _joint_view_order(rows: Ints, parents: Any, boxes: Any) -> Ints:
    """Views in the order of their summed ranks in `view_order` of the leaves in `rows`."""
    rank = np.zeros(len(boxes.origin))
    for i in rows:
        rank[view_order(i, parents, boxes)] += np.arange(len(rank))
    return np.argsort(rank, kind="mergesort")


@njit(cache=True)
def _pairwise_ratios(v: int, rows: Ints, parents: Any, boxes: Any, limits: Any, children: Any) -> Array:
    """Log-likelihood ratio (k, d) of each box of view v for the partial child of each leaf in `rows`; −inf where it is not taken."""
    first, end = boxes.start[v], boxes.start[v + 1]
    out = np.full((len(rows), end - first), -np.inf)
    for k, i in enumerate(rows):
        gated, ratios = np.full(MAX_GATED, -1), np.empty(MAX_GATED)
        found = gate(v, i, parents, boxes, limits, gated, ratios)
        of_child = child_ratios(k, i, v, parents, boxes, limits, children, gated, ratios)
        for g, d in enumerate(gated[:found]):
            if of_child[g] + boxes.weakness[d] > limits.least_fit:
                out[k, d - first] = of_child[g]
    return out


@njit(cache=True)
def _update_all(v: int, box: Ints, parents: Any, boxes: Any, limits: Any, children: Any) -> None:
    """Update each partial child, in place, by its box (k,) of view v, −1 for a missed detection."""
    predicted = np.empty(PREDICTED)
    for k in range(len(box)):
        i, d = children.parent[k], box[k]
        if d < 0:
            children.increment[k] += parents.missed[i, v]
            children.missed[k] += parents.missed[i, v]
            continue
        predict_measurement(children.state[k], i, parents, v, boxes, predicted)
        ratio = log_likelihood(predicted, children.state[k], children.covariance[k], v, d, boxes, limits)
        children.increment[k] += ratio + parents.links[i, d]
        update_child(k, i, v, d, parents, boxes, limits, children)
