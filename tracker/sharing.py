"""The way on of leaves that are true together: the boxes of each view are shared out among them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from tracker.geometry import Array
from tracker.looks import NEAREST, Boxes, Branches, Numbers, Standing, accept, blank, expected, fit, look_at, order, reached

Ints = NDArray[np.int64]


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
        i, d = linear_sum_assignment(more, maximize=True)
        taken = more[i, d] > 0
        box = np.full(k, -1)
        box[i[taken]] = d[taken] + boxes.start[v]
        _take(v, box, leaves, boxes, n, out)
    return out, worth


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
            worth = fit(look, S0, v, d, boxes, n.gate)
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
