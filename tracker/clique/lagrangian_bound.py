"""Lagrange's bound of a clique's weight, compiled: lowered step by step, what it rules out, and branches on what it leaves.

With a multiplier y ≥ 0 on each class of vertices that exclude each other, and the vertices parted into groups (each within a class), no clique
weighs more than Σ y + Σ_groups max(0, max_v w_v − Σ_{classes of v} y). A step goes from the least bound so far against the excess of the classes
under the mean of the late picks (Barahona & Anbil 2000, The volume algorithm), as far as Polyak (1969) says for the weight that is known.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import njit

from tracker.geometry import Array, Ints, Mask

ROOT, NODE = 300, 60
"""Steps of the multipliers before the first branch, and at each further one."""

STALL = 5
"""Steps without a lower bound after which they are made shorter."""

FIX = 10
"""Steps from one look at what can be fixed, and at what the multipliers suggest, to the next."""

DEEPEST = 200
"""Branches that lie above each other, at most."""

LONGER, SHORTER = 1.2, 0.6
"""What a step's length is multiplied by where it might have gone farther, and where it went too far too often."""

MIX = 0.1
"""Share of the latest pick in the mean of picks."""

EXACT = 1e-10
"""Of the weight: what is no more than this above the best is not better."""


class Packing(NamedTuple):
    """weight (n,); start, conflict: as in Graph; members of class c are member[first[c] : first[c + 1]]; the classes with multipliers of vertex v
    are inside[enter[v] : enter[v + 1]]; group (n,)."""

    weight: Array
    start: Ints
    conflict: Ints
    first: Ints
    member: Ints
    enter: Ints
    inside: Ints
    group: Ints


class Work(NamedTuple):
    """best (n,), most (1,): the heaviest clique so far; reduced (n,): weight less multipliers; often (n,): how often a vertex was picked of late;
    top, second, pick (groups,): the two largest of a group and whose the first is; step (classes,): the direction; trial (n,); least (classes,):
    multipliers of the least bound."""

    best: Mask
    most: Array
    reduced: Array
    often: Array
    top: Array
    second: Array
    pick: Ints
    step: Array
    trial: Mask
    least: Array


@njit(cache=True)
def _bound(p: Any, w: Any, free: Mask, y: Array) -> float:
    """Lagrange's bound of the free vertices at these multipliers; reduced weights and the two best of each group are left in w."""
    w.top[:], w.second[:], w.pick[:] = 0.0, 0.0, -1
    for v in range(len(free)):
        if not free[v]:
            continue
        r = p.weight[v]
        for k in range(p.enter[v], p.enter[v + 1]):
            r -= y[p.inside[k]]
        w.reduced[v] = r
        g = p.group[v]
        if r > w.top[g]:
            w.top[g], w.second[g], w.pick[g] = r, w.top[g], v
        elif r > w.second[g]:
            w.second[g] = r
    return y.sum() + w.top.sum()


@njit(cache=True)
def _suggested(p: Any, w: Any, free: Mask, value: Array) -> None:
    """The clique of the vertices of most value that go together, taken where it is the heaviest so far."""
    rows = np.flatnonzero(free)
    blocked, total = w.trial, 0.0
    blocked[:] = False
    chosen = np.zeros(len(free), np.bool_)
    for k in np.argsort(-value[rows], kind="mergesort"):
        v = rows[k]
        if not blocked[v]:
            chosen[v] = True
            total += p.weight[v]
            for q in range(p.start[v], p.start[v + 1]):
                blocked[p.conflict[q]] = True
    if total > w.most[0] * (1 + EXACT):
        w.most[0] = total
        w.best[:] = chosen


@njit(cache=True)
def _fix(p: Any, w: Any, free: Mask, spare: float) -> None:
    """Take out of `free` what no clique holds that is better than the best; spare: how far the bound is above that."""
    for v in range(len(free)):
        if free[v] and w.top[p.group[v]] - w.reduced[v] >= spare:
            free[v] = False
    for g in range(len(w.pick)):
        v = w.pick[g]
        # Without v the bound is no better than the best: it is in, and what it excludes is out.
        if v >= 0 and w.top[g] - w.second[g] >= spare:
            for k in range(p.start[v], p.start[v + 1]):
                free[p.conflict[k]] = False


@njit(cache=True)
def _pick(p: Any, w: Any, share: float) -> None:
    """Count what the groups pick now by its share among what they picked before."""
    w.often[:] *= 1 - share
    for v in w.pick:
        if v >= 0:
            w.often[v] += share


@njit(cache=True)
def _along(p: Any, w: Any) -> float:
    """The step against the excess of the classes under what is picked now: above 0 where the bound still falls that way."""
    along = w.step.sum()
    for v in w.pick:
        if v >= 0:
            for k in range(p.enter[v], p.enter[v + 1]):
                along -= w.step[p.inside[k]]
    return float(along)


@njit(cache=True)
def lower(p: Any, w: Any, free: Mask, y: Array, steps: int) -> bool:
    """Lower the bound by some steps of y (changed), fix what can be; whether nothing better is left."""
    lowest, length, stalled = _bound(p, w, free, y), 1.0, 0
    w.least[:] = y
    _pick(p, w, 1.0 if w.often.sum() == 0 or steps == ROOT else 0.2)
    for t in range(steps):
        if lowest <= w.most[0] * (1 + EXACT):
            return True
        norm = 0.0
        for c in range(len(y)):
            s = 1.0
            for k in range(p.first[c], p.first[c + 1]):
                if free[p.member[k]]:
                    s -= w.often[p.member[k]]
            w.step[c] = s if w.least[c] > 0 or s < 0 else 0.0
            norm += w.step[c] * w.step[c]
        if norm < 1e-12:
            break
        far = length * (lowest - w.most[0]) / norm
        for c in range(len(y)):
            y[c] = max(0.0, w.least[c] - far * w.step[c])
        bound = _bound(p, w, free, y)
        _pick(p, w, MIX)
        if bound < lowest:
            length *= LONGER if _along(p, w) > 0 else 1.0
            lowest, stalled = bound, 0
            w.least[:] = y
        else:
            stalled += 1
            if stalled == STALL:
                length, stalled = length * SHORTER, 0
        if t % FIX == FIX - 1:
            _bound(p, w, free, w.least)
            _suggested(p, w, free, w.reduced if t % (2 * FIX) == FIX - 1 else w.often)
            _fix(p, w, free, lowest - w.most[0] * (1 + EXACT))
    y[:] = w.least
    bound = _bound(p, w, free, y)
    _suggested(p, w, free, w.often)
    _suggested(p, w, free, w.reduced)
    _fix(p, w, free, bound - w.most[0] * (1 + EXACT))
    return _bound(p, w, free, y) <= w.most[0] * (1 + EXACT)


@njit(cache=True)
def _branching(p: Any, w: Any, free: Mask) -> int:
    """The vertex to branch on: of those that the groups pick, the one that excludes most of the others, by weight; −1 where nothing excludes."""
    best, worth = -1, -1.0
    for v in range(len(free)):
        if not free[v]:
            continue
        clash, picked = 0.0, w.pick[p.group[v]] == v
        for k in range(p.start[v], p.start[v + 1]):
            u = p.conflict[k]
            if free[u]:
                clash = max(clash, 1e-6 * p.weight[v])
                if picked and w.pick[p.group[u]] == u:
                    clash += min(p.weight[v], p.weight[u])
        if clash > 0 and clash > worth:
            best, worth = v, clash
    return best


@njit(cache=True)
def settle(p: Any, w: Any, root: Mask, multipliers: Array, branches: int) -> bool:
    """Branch on one vertex after another, in or out, from what is free at the root; whether the search is over."""
    n, classes = len(p.weight), len(p.first) - 1
    deepest = min(n, DEEPEST) + 1
    free, y, vertex = np.ones((deepest, n), np.bool_), np.zeros((deepest, classes)), np.full(deepest, -1)
    free[0], y[0], depth = root, multipliers, 0
    for _ in range(branches):
        done = lower(p, w, free[depth], y[depth], NODE)
        v = -1 if done else _branching(p, w, free[depth])
        if v >= 0:
            if depth + 1 == deepest:
                return False
            vertex[depth] = v
            free[depth + 1], y[depth + 1] = free[depth], y[depth]
            depth += 1
            for k in range(p.start[v], p.start[v + 1]):
                free[depth, p.conflict[k]] = False
            continue
        # Back to the last vertex that was in, which is out now: what is left of that branch is looked at in its place.
        depth -= 1
        if depth < 0:
            return True
        free[depth, vertex[depth]] = False
    return False
