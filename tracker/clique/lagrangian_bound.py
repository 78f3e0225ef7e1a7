"""The Lagrangian bound of a clique's weight, compiled: subgradient steps, variable fixing, and branch and bound.

Each class of vertices that exclude each other has a multiplier y ≥ 0. The vertices are partitioned into groups, each within a class.
No clique weighs more than `Σ y + Σ_groups max(0, max_v w_v − Σ_{classes of v} y)`. In a step every group picks its vertex of the largest reduced
weight, and the mean of the picks is the primal estimate (Barahona & Anbil 2000, The volume algorithm). The step starts at the multipliers of
the least bound, and follows the subgradient at the primal estimate. Its length is that of Polyak (1969) for the best known weight.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from tracker.geometry import Array, Ints, Mask
from tracker.geometry.compilation import njit

ROOT_STEPS, NODE_STEPS = 300, 60
"""Steps of the multipliers before the first branch, and at each branch."""

STALL = 5
"""Steps without a lower bound after which the step length is reduced."""

FIX = 10
"""Steps between two runs of variable fixing and of the rounding heuristic."""

DEEPEST = 200
"""Greatest depth of the branches."""

LONGER, SHORTER = 1.2, 0.6
"""Factors of the step factor: where the bound still falls along the step, and after STALL steps without a lower bound."""

MIX = 0.1
"""Share of the latest picks in the primal estimate."""

TOLERANCE = 1e-10
"""Relative tolerance of the weight: a clique that exceeds the best by less is not better."""


class SetPacking(NamedTuple):
    """A graph with its classes and groups.

    weight (n,); start, conflict: as in Graph. The members of class c are member[first[c] : first[c + 1]]. The classes with multipliers of vertex v
    are inside[enter[v] : enter[v + 1]]. group (n,).
    """

    weight: Array
    start: Ints
    conflict: Ints
    first: Ints
    member: Ints
    enter: Ints
    inside: Ints
    group: Ints


class BoundState(NamedTuple):
    """Arrays that a minimization changes.

    best (n,), best_weight (1,): the heaviest clique so far; reduced (n,): weights less multipliers; primal (n,): the primal estimate.
    top, second, pick (groups,): the two largest reduced weights of a group, and the vertex of the first. step (classes,): the direction;
    trial (n,): work space; least_y (classes,): the multipliers of the least bound.
    """

    best: Mask
    best_weight: Array
    reduced: Array
    primal: Array
    top: Array
    second: Array
    pick: Ints
    step: Array
    trial: Mask
    least_y: Array


@njit(cache=True)
def _bound(p: Any, w: Any, free: Mask, y: Array) -> float:
    """The Lagrangian bound of the free vertices at the multipliers y; reduced weights and the picks of each group are left in w."""
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
def _round(p: Any, w: Any, free: Mask, value: Array) -> None:
    """Rounding heuristic: the greedy clique by descending `value` (n,), taken where it is the heaviest so far."""
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
    if total > w.best_weight[0] * (1 + TOLERANCE):
        w.best_weight[0] = total
        w.best[:] = chosen


@njit(cache=True)
def _fix(p: Any, w: Any, free: Mask, spare: float) -> None:
    """Variable fixing: remove from `free` the vertices that no better clique holds; spare: the bound less the best weight."""
    for v in range(len(free)):
        if free[v] and w.top[p.group[v]] - w.reduced[v] >= spare:
            free[v] = False
    for g in range(len(w.pick)):
        v = w.pick[g]
        # Without v the bound is at most the best weight, so v is in every better clique, and the vertices that it excludes are not.
        if v >= 0 and w.top[g] - w.second[g] >= spare:
            for k in range(p.start[v], p.start[v + 1]):
                free[p.conflict[k]] = False


@njit(cache=True)
def _update_primal(p: Any, w: Any, share: float) -> None:
    """Update the primal estimate by the latest picks, which have this share in it."""
    w.primal[:] *= 1 - share
    for v in w.pick:
        if v >= 0:
            w.primal[v] += share


@njit(cache=True)
def _slope(p: Any, w: Any) -> float:
    """The step times the subgradient at the latest picks: above 0 where the bound still falls along the step."""
    slope = w.step.sum()
    for v in w.pick:
        if v >= 0:
            for k in range(p.enter[v], p.enter[v + 1]):
                slope -= w.step[p.inside[k]]
    return float(slope)


@njit(cache=True)
def minimize_bound(p: Any, w: Any, free: Mask, y: Array, steps: int) -> bool:
    """Minimize the bound by at most `steps` steps of y, in place, and fix variables; return whether the best clique is proved optimal."""
    lowest, factor, stalled = _bound(p, w, free, y), 1.0, 0
    w.least_y[:] = y
    _update_primal(p, w, 1.0 if w.primal.sum() == 0 or steps == ROOT_STEPS else 0.2)
    for t in range(steps):
        if lowest <= w.best_weight[0] * (1 + TOLERANCE):
            return True
        norm = 0.0
        for c in range(len(y)):
            s = 1.0
            for k in range(p.first[c], p.first[c + 1]):
                if free[p.member[k]]:
                    s -= w.primal[p.member[k]]
            w.step[c] = s if w.least_y[c] > 0 or s < 0 else 0.0
            norm += w.step[c] * w.step[c]
        if norm < 1e-12:
            break
        step_length = factor * (lowest - w.best_weight[0]) / norm
        for c in range(len(y)):
            y[c] = max(0.0, w.least_y[c] - step_length * w.step[c])
        bound = _bound(p, w, free, y)
        _update_primal(p, w, MIX)
        if bound < lowest:
            factor *= LONGER if _slope(p, w) > 0 else 1.0
            lowest, stalled = bound, 0
            w.least_y[:] = y
        else:
            stalled += 1
            if stalled == STALL:
                factor, stalled = factor * SHORTER, 0
        if t % FIX == FIX - 1:
            _bound(p, w, free, w.least_y)
            _round(p, w, free, w.reduced if t % (2 * FIX) == FIX - 1 else w.primal)
            _fix(p, w, free, lowest - w.best_weight[0] * (1 + TOLERANCE))
    y[:] = w.least_y
    bound = _bound(p, w, free, y)
    _round(p, w, free, w.primal)
    _round(p, w, free, w.reduced)
    _fix(p, w, free, bound - w.best_weight[0] * (1 + TOLERANCE))
    return _bound(p, w, free, y) <= w.best_weight[0] * (1 + TOLERANCE)


@njit(cache=True)
def _branching_vertex(p: Any, w: Any, free: Mask) -> int:
    """The vertex to branch on: the picked one that excludes most weight of other picks; −1 where no free vertices exclude each other."""
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
def branch(p: Any, w: Any, root: Mask, multipliers: Array, branches: int) -> bool:
    """Depth-first branch and bound over the vertices that are free at the root, each taken in or out; return whether it is complete."""
    n, classes = len(p.weight), len(p.first) - 1
    deepest = min(n, DEEPEST) + 1
    free, y, vertex = np.ones((deepest, n), np.bool_), np.zeros((deepest, classes)), np.full(deepest, -1)
    free[0], y[0], depth = root, multipliers, 0
    for _ in range(branches):
        done = minimize_bound(p, w, free[depth], y[depth], NODE_STEPS)
        v = -1 if done else _branching_vertex(p, w, free[depth])
        if v >= 0:
            if depth + 1 == deepest:
                return False
            vertex[depth] = v
            free[depth + 1], y[depth + 1] = free[depth], y[depth]
            depth += 1
            for k in range(p.start[v], p.start[v + 1]):
                free[depth, p.conflict[k]] = False
            continue
        # Backtrack to the last vertex that is in, and take it out: the other branch replaces the first one.
        depth -= 1
        if depth < 0:
            return True
        free[depth, vertex[depth]] = False
    return False
