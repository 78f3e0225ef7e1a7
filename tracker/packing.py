"""The heaviest clique as a set packing: bounded by multipliers on classes of vertices that exclude each other, and so proved where classes are large.

Every conflict lies in a class of pairwise conflicts, and a clique holds one vertex of a class at most. With a multiplier y ≥ 0 on each class and the
vertices parted into groups (each within a class), no clique weighs more than Σ y + Σ_groups max(0, max_v w_v − Σ_{classes of v} y), Lagrange's
bound, which at its least is that of the linear program over the classes. It is lowered by projected subgradient steps of Polyak's length (Held, Wolfe,
Crowder 1974, Validation of subgradient optimization); what it shows to be in no better clique, or in every one, is fixed; the rest is branched on.
Conflicts of trackers come from trees and boxes, whose leaves are such classes, and that program is then nearly integral.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from tracker.clique import Graph, Limits, Options, Tuning, search
from tracker.geometry import Array

Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]

ROUNDS = 5
ROOT, NODE = 300, 60
"""Steps of the multipliers before the first branch, and at each further one."""
STALL = 5
"""Steps without a lower bound after which they are made half as long."""
FIX = 10
"""Steps from one look at what can be fixed, and at what the multipliers suggest, to the next."""
DEEPEST = 200
"""Branches that lie above each other, at most."""
SHRUNK = 0.7
"""Share of the vertices below which what is left is a graph of its own."""
FIRST, LONGER, SHORT, MIX = 1.0, 1.2, 0.6, 0.1
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
    """best (n,), most (1,): the heaviest clique so far; reduced (n,): weight less multipliers; often (n,): how often a vertex
    was picked of late; top, second, pick (groups,): the two largest of a
    group and whose the first is; step (classes,): the direction; trial (n,), least (classes,): multipliers of the least bound."""

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


@dataclass(frozen=True)
class Effort:
    """What a solution may cost: moves of a search before the multipliers (0: none) and seed of it, branches at most of each part."""

    moves: int = 2000
    seed: int = 0
    branches: int = 100


def settled(graph: Graph, known: Ints, effort: Effort) -> tuple[Ints, bool]:
    """The heaviest clique found, at least as heavy as the clique `known`, and whether it is proved to be the heaviest.

    The same graph, clique and effort give the same result. Takes memory for a matrix of the vertices.
    """
    inside = np.zeros(len(graph), dtype=bool)
    inside[known] = True
    rows = np.flatnonzero(~_dominated(graph.weight, graph.start, graph.conflict))
    label = _labels(graph.start, graph.conflict, rows)
    chosen, proved = [np.zeros(0, dtype=np.int64)], True
    order = np.argsort(label, kind="stable")
    for part in np.split(rows[order], np.flatnonzero(np.diff(label[order])) + 1):
        if len(part) == 1:
            chosen.append(part)
            continue
        best, sure = _part(_within(graph, part), np.flatnonzero(inside[part]), effort)
        chosen.append(part[best])
        proved &= sure
    found = np.sort(np.concatenate(chosen))
    return (found if graph.weight[found].sum() > graph.weight[known].sum() else known), proved


def _part(graph: Graph, known: Ints, effort: Effort) -> tuple[Ints, bool]:
    """`settled` for a graph whose conflicts hold together: what the multipliers leave is a smaller graph, to be settled anew or branched on."""
    if effort.moves:
        known = search(graph, Limits(moves=effort.moves), effort.seed, Options(start=known, tuning=Tuning(T=10))).vertices
    n = len(graph)
    first, member, group, groups = _classes(graph)
    best, most = np.zeros(n, dtype=bool), np.array([graph.weight[known].sum()])
    best[known] = True
    free, y, often, proved = np.ones(n, dtype=bool), np.zeros(0), np.zeros(n), False
    for _ in range(ROUNDS):
        packing, y = _packed(graph, first, member, group), np.append(y, np.zeros(len(first) - 1 - len(y)))
        work = Work(
            best, most, np.zeros(n), often, np.zeros(groups), np.zeros(groups), np.zeros(groups, np.int64), np.zeros(len(y)), np.zeros(n, np.bool_),
            np.zeros(len(y)),
        )  # fmt: skip
        if _lower(packing, work, free, y, ROOT):
            return np.flatnonzero(best), True
        rows = np.flatnonzero(free)
        if len(rows) < SHRUNK * n:
            inner, proved = settled(_within(graph, rows), np.flatnonzero(best[rows]), replace(effort, moves=0))
            return (rows[inner] if graph.weight[rows[inner]].sum() > most[0] else np.flatnonzero(best)), proved
        more, others = _violated(graph.start, graph.conflict, free, often)
        if len(more) == 1:
            break
        first, member = np.append(first, first[-1] + more[1:]), np.append(member, others)
    proved = bool(_settle(packing, work, free, y, effort.branches))
    return np.flatnonzero(best), proved


def _within(graph: Graph, rows: Ints) -> Graph:
    """The graph of some of the vertices, ascending."""
    number = np.full(len(graph), -1)
    number[rows] = np.arange(len(rows))
    other = number[graph.conflict]
    both = np.repeat(number >= 0, np.diff(graph.start)) & (other >= 0)
    degree = np.add.reduceat(np.append(both, False), graph.start[:-1]) * (np.diff(graph.start) > 0)
    return Graph.from_rows(graph.weight[rows], degree[rows], other[both])


@njit(cache=True)
def _dominated(weight: Array, start: Ints, conflict: Ints) -> Mask:
    """Which vertices (n,) need not be looked at: another that they exclude is as heavy, and excludes nothing else."""
    n = len(weight)
    out, mark = np.zeros(n, np.bool_), np.full(n, -1)
    for v in range(n):
        mark[v] = v
        for k in range(start[v], start[v + 1]):
            mark[conflict[k]] = v
        for k in range(start[v], start[v + 1]):
            u = conflict[k]
            if out[u] or weight[u] < weight[v] or (weight[u] == weight[v] and u > v) or start[u + 1] - start[u] > start[v + 1] - start[v]:
                continue
            q = start[u]
            while q < start[u + 1] and mark[conflict[q]] == v:
                q += 1
            if q == start[u + 1]:
                out[v] = True
                break
    return out


@njit(cache=True)
def _labels(start: Ints, conflict: Ints, rows: Ints) -> Ints:
    """Of each of `rows` (k,) the number of its connected part of the conflicts among them."""
    label, place, waiting, count = np.full(len(rows), -1), np.full(len(start), -1), np.empty(len(rows), np.int64), 0
    place[rows] = np.arange(len(rows))
    for first in range(len(rows)):
        if label[first] >= 0:
            continue
        label[first], waiting[0], size = count, first, 1
        while size:
            size -= 1
            v = rows[waiting[size]]
            for k in range(start[v], start[v + 1]):
                u = place[conflict[k]]
                if u >= 0 and label[u] < 0:
                    label[u], waiting[size] = count, u
                    size += 1
        count += 1
    return label


def _classes(graph: Graph) -> tuple[Ints, Ints, Ints, int]:
    """Classes that need a multiplier: first, member; group (n,) and how many groups."""
    first, member = _cover(graph.start, graph.conflict)
    group, groups, whole = _grouped(first, member, len(graph))
    # A class that is a group needs none.
    count = np.diff(first)
    return np.concatenate([[0], np.cumsum(count[~whole])]), member[np.repeat(~whole, count)], group, groups


def _packed(graph: Graph, first: Ints, member: Ints, group: Ints) -> Packing:
    order = np.argsort(member, kind="stable")
    enter = np.concatenate([[0], np.cumsum(np.bincount(member, minlength=len(graph)))])
    owner = np.repeat(np.arange(len(first) - 1), np.diff(first))
    return Packing(graph.weight, graph.start, graph.conflict, first, member, enter, owner[order], group)


@njit(cache=True)
def _violated(start: Ints, conflict: Ints, free: Mask, often: Array) -> tuple[Ints, Ints]:
    """Classes of which more than one vertex is picked on the average, each grown greedily from one vertex: first, member."""
    n = len(start) - 1
    first, member = [0], [np.int64(0) for _ in range(0)]
    mark, stamp, done = np.zeros(n, np.int64), 0, np.zeros(n, np.bool_)
    fits = np.empty(n, np.int64)
    value = often + 1e-9 * np.diff(start)
    for a in np.argsort(-often, kind="mergesort"):
        if not free[a] or often[a] < 0.01:
            continue
        size = 0
        for k in range(start[a], start[a + 1]):
            if free[conflict[k]]:
                fits[size] = conflict[k]
                size += 1
        member.append(np.int64(a))
        total, fresh = often[a], not done[a]
        while size:
            v = fits[0]
            for q in range(1, size):
                if value[fits[q]] > value[v]:
                    v = fits[q]
            member.append(v)
            total += often[v]
            fresh = fresh or (often[v] > 0.01 and not done[v])
            stamp += 1
            for k in range(start[v], start[v + 1]):
                mark[conflict[k]] = stamp
            kept = 0
            for q in range(size):
                if mark[fits[q]] == stamp:
                    fits[kept] = fits[q]
                    kept += 1
            size = kept
        if total > 1.03 and fresh:
            for k in range(first[-1], len(member)):
                done[member[k]] = True
            first.append(len(member))
        else:
            while len(member) > first[-1]:
                member.pop()
    return np.array(first), np.array(member)


@njit(cache=True)
def _cover(start: Ints, conflict: Ints) -> tuple[Ints, Ints]:
    """Classes such that every conflict is in one, each grown from a conflict that is in none by the vertex that brings most others: first, member."""
    n = len(start) - 1
    left, clash = np.zeros((n, n), np.bool_), np.zeros((n, n), np.bool_)
    for v in range(n):
        for k in range(start[v], start[v + 1]):
            left[v, conflict[k]] = clash[v, conflict[k]] = True
    first, member = [0], [np.int64(0) for _ in range(0)]
    fits, fresh = np.empty(n, np.int64), np.zeros(n, np.int64)
    for a in range(n):
        for k in range(start[a], start[a + 1]):
            if not left[a, conflict[k]]:
                continue
            size = 0
            for q in range(start[a], start[a + 1]):
                fits[size], fresh[conflict[q]] = conflict[q], left[a, conflict[q]]
                size += 1
            member.append(np.int64(a))
            v = conflict[k]
            while v >= 0:
                member.append(v)
                kept, following = 0, -1
                for q in range(size):
                    u = fits[q]
                    if clash[v, u]:
                        fits[kept] = u
                        fresh[u] += left[v, u]
                        kept += 1
                        if following < 0 or fresh[u] > fresh[following]:
                            following = u
                size, v = kept, following
            for p in range(first[-1], len(member)):
                for q in range(first[-1], len(member)):
                    left[member[p], member[q]] = False
            first.append(len(member))
    return np.array(first), np.array(member)


@njit(cache=True)
def _grouped(first: Ints, member: Ints, n: int) -> tuple[Ints, int, Mask]:
    """The vertices parted into groups, always by the class with most that have none: group (n,), how many, and which classes are groups as a whole."""
    classes = len(first) - 1
    group, groups, whole = np.full(n, -1), 0, np.zeros(classes, np.bool_)
    free = np.diff(first)
    while classes:
        c = np.argmax(free)
        if free[c] < 2:
            break
        whole[c] = free[c] == first[c + 1] - first[c]
        for k in range(first[c], first[c + 1]):
            if group[member[k]] < 0:
                group[member[k]] = groups
        groups += 1
        for d in range(classes):
            free[d] = 0
            for k in range(first[d], first[d + 1]):
                free[d] += group[member[k]] < 0
    for v in range(n):
        if group[v] < 0:
            group[v] = groups
            groups += 1
    return group, groups, whole


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
def _lower(p: Any, w: Any, free: Mask, y: Array, steps: int) -> bool:
    """Lower the bound by some steps of y (changed), fix what can be; whether nothing better is left."""
    lowest, length, stalled = _bound(p, w, free, y), FIRST, 0
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
            along = 0.0
            for g in range(len(w.pick)):
                v = w.pick[g]
                if v >= 0:
                    for k in range(p.enter[v], p.enter[v + 1]):
                        along -= w.step[p.inside[k]]
            for c in range(len(y)):
                along += w.step[c]
            if along > 0:
                length *= LONGER
            lowest, stalled = bound, 0
            w.least[:] = y
        else:
            stalled += 1
            if stalled == STALL:
                length, stalled = length * SHORT, 0
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
def _settle(p: Any, w: Any, root: Mask, multipliers: Array, branches: int) -> bool:
    """Branch on one vertex after another, in or out, from what is free at the root; whether the search is over."""
    n, classes = len(p.weight), len(p.first) - 1
    deepest = min(n, DEEPEST) + 1
    free, y, vertex = np.ones((deepest, n), np.bool_), np.zeros((deepest, classes)), np.full(deepest, -1)
    free[0], y[0], depth = root, multipliers, 0
    for _ in range(branches):
        done = _lower(p, w, free[depth], y[depth], NODE)
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
