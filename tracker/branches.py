"""The inner loops of the track trees, compiled: every way in which a leaf may go on at a tick.

A leaf takes at most one box a view. The views are gone through from the one that places feet best; in each, every way so far is corrected by
every box within the gate, or by none, and the best few ways are kept (a search over combinations with a gate that tightens, as each box makes
the place surer, and a cap).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from tracker.looks import NEAREST, Boxes, Branches, Numbers, Standing, accept, blank, expected, fit, look_at, order, reached

Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]

NARROW = 2
"""Ways that are followed from view to view where only the best without some box is wanted."""


@njit(cache=True)
def _ways(i: int, leaves: Any, boxes: Any, n: Any, near: Ints, banned: Mask, beam: Any) -> int:
    """All ways of leaf i to go on into the arrays of `beam` (a Branches; as many are followed as it has rows), unordered; how many.

    near (V, NEAREST): boxes that it may take, −1 after the last; banned (D,): those that it must not.
    """
    B = len(beam.gain)
    look = np.empty(16)
    beam.state[0], beam.covariance[0], beam.gain[0], count = leaves.state[i], leaves.covariance[i], 0.0, 1
    beam.box[:], beam.residual[:], beam.missed[:] = -1, np.nan, 0.0
    size = B * (NEAREST + 1)
    worth, source, taken = np.empty(size), np.empty(size, np.int64), np.empty(size, np.int64)
    for v in order(i, leaves, boxes):
        missed = leaves.missed[i, v]
        if near[v, 0] < 0:
            beam.gain[:count] += missed
            beam.missed[:count] += missed
            continue
        offers = 0
        for b in range(count):
            worth[offers], source[offers], taken[offers] = beam.gain[b] + missed, b, -1
            offers += 1
            look_at(beam.state[b], leaves.z[i], leaves.slope[i], boxes.origin[v], look)
            S0 = expected(look, beam.covariance[b], n.foot_spread)
            for d in near[v]:
                if d < 0:
                    break
                if banned[d]:
                    continue
                more = fit(look, S0, v, d, boxes, n.gate) + leaves.alike[i, d]
                if more > max(missed - n.width, n.least):
                    worth[offers], source[offers], taken[offers] = beam.gain[b] + more, b, d
                    offers += 1
        chosen = np.argsort(-worth[:offers], kind="mergesort")[:B]
        state, covariance, box = beam.state.copy(), beam.covariance.copy(), beam.box.copy()
        residuals, Hs, Ss, absent = beam.residual.copy(), beam.H.copy(), beam.S.copy(), beam.missed.copy()
        for q in range(len(chosen)):
            b, d = source[chosen[q]], taken[chosen[q]]
            beam.state[q], beam.covariance[q], beam.box[q], beam.gain[q] = state[b], covariance[b], box[b], worth[chosen[q]]
            beam.residual[q], beam.H[q], beam.S[q] = residuals[b], Hs[b], Ss[b]
            beam.missed[q] = absent[b]
            if d < 0:
                beam.missed[q] += missed
                continue
            accept(q, i, v, d, leaves, boxes, n, beam)
        count = len(chosen)
    return count


@njit(cache=True)
def _wanted(leaves: Any, boxes: Any, n: Any) -> tuple[Any, Mask]:
    """Boxes (n, V, NEAREST) that each leaf may take, −1 after the last, and which boxes (D,) leaves of several trees may take."""
    V, D = len(boxes.origin), len(boxes.usable)
    near, owner = np.full((len(leaves.state), V, NEAREST), -1), np.full(D, -1)
    for i in range(len(leaves.state)):
        if leaves.over[i]:
            continue
        for v in range(V):
            for k in range(reached(v, i, leaves, boxes, n, near[i, v])):
                d, t = near[i, v, k], leaves.tree[i]
                owner[d] = t if owner[d] == -1 or owner[d] == t else -2
    return near, owner == -2


@njit(cache=True)
def _write(out: Any, m: int, start: int, i: int, beam: Any, b: int) -> int:
    """Way b of leaf i into row m, unless it is among rows start to m or takes no box; the next free row."""
    if not (beam.box[b] >= 0).any():
        return m
    for k in range(start, m):
        if (out.box[k] == beam.box[b]).all():
            return m
    out.parent[m], out.box[m], out.gain[m], out.missed[m] = i, beam.box[b], beam.gain[b], beam.missed[b]
    out.state[m], out.covariance[m], out.residual[m] = beam.state[b], beam.covariance[b], beam.residual[b]
    out.H[m], out.S[m] = beam.H[b], beam.S[b]
    return m + 1


@njit(cache=True)
def _spared(box: Ints, banned: Mask) -> bool:
    """Whether one of the ways (k, V) takes none of the boxes that are banned."""
    for k in range(len(box)):
        free = True
        for v in range(box.shape[1]):
            free = free and (box[k, v] < 0 or not banned[box[k, v]])
        if free:
            return True
    return False


@njit(cache=True)
def grow(leaves: Standing, boxes: Boxes, n: Numbers) -> Branches:
    """All ways in which the leaves may go on at this tick; each has one without any box.

    Of the best way, each box that another tree may take, too, is forbidden in turn, and then all of them, where no way does without already:
    whatever others take, a way is left.
    """
    V = len(boxes.origin)
    out = Branches(*blank(len(leaves.state) * (n.most + V + 2), V))
    beam, narrow = Branches(*blank(n.beam, V)), Branches(*blank(min(n.beam, NARROW), V))
    near, contested = _wanted(leaves, boxes, n)
    banned = np.zeros(len(boxes.usable), np.bool_)
    m = 0
    for i in range(len(leaves.state)):
        if not leaves.over[i]:
            count, start = _ways(i, leaves, boxes, n, near[i], banned, beam), m
            ranked = np.argsort(-beam.gain[:count], kind="mergesort")
            least = beam.gain[ranked[0]] - n.width
            for b in ranked:
                if m - start < n.most and beam.gain[b] >= least:
                    m = _write(out, m, start, i, beam, b)
            taken = out.box[start].copy() if m > start else np.full(V, -1)
            for v in range(V + 1):
                for w in range(V):
                    if (w == v or v == V) and taken[w] >= 0 and contested[taken[w]]:
                        banned[taken[w]] = True
                if banned.any() and not _spared(out.box[start:m], banned):
                    count = _ways(i, leaves, boxes, n, near[i], banned, narrow)
                    b = int(np.argmax(narrow.gain[:count]))
                    if narrow.gain[b] >= least:
                        m = _write(out, m, start, i, narrow, b)
                banned[:] = False
        out.parent[m], out.state[m], out.covariance[m] = i, leaves.state[i], leaves.covariance[i]
        # Where all views lose a person at once they do so for one reason.
        out.gain[m] = 0.0 if leaves.over[i] else max(leaves.missed[i].sum(), n.floor)
        out.missed[m] = out.gain[m]
        m += 1
    return Branches(
        out.parent[:m].copy(), out.box[:m].copy(), out.gain[:m].copy(), out.missed[:m].copy(), out.state[:m].copy(), out.covariance[:m].copy(),
        out.residual[:m].copy(), out.H[:m].copy(), out.S[:m].copy(),
    )  # fmt: skip
