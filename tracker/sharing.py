"""The way on of leaves that are true together: the boxes of each view are shared out among them."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from tracker.geometry import Array
from tracker.looks import NEAREST, Boxes, Branches, Numbers, Standing, accept, blank, expected, fit, look_at, order, reached

Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]

SURE = 50.0
"""Log-likelihood by which nothing is worse that is looked at."""


def shared(rows: Ints, leaves: Standing, boxes: Boxes, n: Numbers) -> tuple[Branches, Array]:
    """One way for each of `rows`, leaves that are true together: view after view the boxes are shared out among them for the highest sum. Ways that
    are found leaf by leaf seldom go together where people stand close before many views. And what each of them (k, D) would gain by each box over
    none, 0 where nothing."""
    k, V = len(rows), len(boxes.origin)
    out, worth = Branches(*blank(k, V)), np.zeros((k, len(boxes.usable)))
    out.parent[:] = rows
    out.state[:], out.covariance[:] = leaves.state[rows], leaves.covariance[rows]
    for v in _from_best(rows, leaves, boxes):
        more = np.maximum(_gains(v, rows, leaves, boxes, n, out) - leaves.missed[rows, v, None], 0.0)
        worth[:, boxes.start[v] : boxes.start[v + 1]] = more
        i, d = _shared_out(more)
        box = np.full(k, -1)
        box[i] = d + boxes.start[v]
        _take(v, box, leaves, boxes, n, out)
    return out, worth


def claimed(rows: Ints, ways: Branches, boxes: Boxes) -> Mask:
    """Which boxes (D,) somebody takes where the leaves in `rows` go on in any of their ways, boxes shared out for the highest sum, view by view."""
    place = np.full(max(ways.parent.max(initial=-1), rows.max(initial=-1)) + 1, -1)
    place[rows] = np.arange(len(rows))
    mine = place[ways.parent] >= 0
    row, box, gain = place[ways.parent[mine]], ways.box[mine], ways.gain[mine]
    out = np.zeros(len(boxes.usable), dtype=bool)
    for v, (start, end) in enumerate(itertools.pairwise(boxes.start.tolist())):
        worth = np.full((len(rows), end - start + 1), -np.inf)
        np.maximum.at(worth, (row, np.where(box[:, v] >= 0, box[:, v] - start, -1)), gain)
        # Where no way is left without a box of this view, one of them is surely theirs.
        none = np.maximum(worth[:, -1:], worth.max(axis=1, keepdims=True) - SURE)
        out[start + _shared_out(np.maximum(worth[:, :-1] - none, 0.0))[1]] = True
    return out


def _shared_out(more: Array) -> tuple[Ints, Ints]:
    """Rows and boxes (m,) that go together for the highest sum of what each row gains by each box over none (k, d), 0 where nothing."""
    rows, boxes = linear_sum_assignment(more, maximize=True)
    taken = more[rows, boxes] > 0
    return rows[taken], boxes[taken]


@njit(cache=True)
def _from_best(rows: Ints, leaves: Any, boxes: Any) -> Ints:
    """Views from the one whose sight lines place most of `rows` best."""
    rank = np.zeros(len(boxes.origin))
    for i in rows:
        rank[order(i, leaves, boxes)] += np.arange(len(rank))
    return np.argsort(rank, kind="mergesort")


@njit(cache=True)
def _gains(v: int, rows: Ints, leaves: Any, boxes: Any, n: Any, ways: Any) -> Array:
    """Log-likelihood ratio (k, d) of each box of view v for each of `rows`, as far as they have gone in `ways`; −inf where it is not taken."""
    first, end = boxes.start[v], boxes.start[v + 1]
    out, look, near = np.full((len(rows), end - first), -np.inf), np.empty(16), np.empty(NEAREST, np.int64)
    for k, i in enumerate(rows):
        found = reached(v, i, leaves, boxes, n, near)
        look_at(ways.state[k], leaves.z[i], leaves.slope[i], boxes.origin[v], look)
        S0 = expected(look, ways.covariance[k], n.foot_spread)
        for d in near[:found]:
            worth = fit(look, S0, v, d, boxes, n.gate) + leaves.alike[i, d]
            if worth > 0.0:
                out[k, d - first] = worth
    return out


@njit(cache=True)
def _take(v: int, box: Ints, leaves: Any, boxes: Any, n: Any, ways: Any) -> None:
    """Go on in `ways`, in place, by the box (k,) that each takes of view v, −1 for none."""
    for k in range(len(box)):
        i, d = ways.parent[k], box[k]
        if d < 0:
            ways.gain[k] += leaves.missed[i, v]
            ways.missed[k] += leaves.missed[i, v]
            continue
        ways.gain[k] += accept(k, i, v, d, leaves, boxes, n, ways)


def merged(ways: Branches, more: Branches) -> Branches:
    """`ways` and those of `more` that take a box and are not among them, in the order of Branches."""
    known = {(p, *b) for p, b in zip(ways.parent.tolist(), ways.box.tolist(), strict=True)}
    found = [(p, *b) not in known and max(b, default=-1) >= 0 for p, b in zip(more.parent.tolist(), more.box.tolist(), strict=True)]
    fresh = np.flatnonzero(found)
    if not len(fresh):
        return ways
    both = Branches._make(np.concatenate([a, b[fresh]]) for a, b in zip(ways, more, strict=True))
    rows = np.lexsort((-both.gain, (both.box < 0).all(axis=1), both.parent))
    return Branches._make(column[rows] for column in both)
