"""What holds between the leaves of track trees, compiled: who excludes whom, what a leaf costs."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from tracker.geometry import Array, Ints, Mask
from tracker.mht.branching import ChildHypotheses


@njit(cache=True)
def prune_branches(ways: ChildHypotheses, tree: Ints, misses: Ints, slack: float, boxes: int) -> Mask:
    """Which ways (m,) are worth keeping: all of a leaf whose best way takes a box that another tree could take, too, or that comes back after it
    was out of sight; of others those within `slack` of the best, as nothing keeps it from being true. tree, misses: of the parents."""
    m, V = ways.box.shape
    owner = np.full(boxes, -1, np.int64)
    for k in range(m):
        for v in range(V):
            d = ways.box[k, v]
            if d >= 0:
                t = tree[ways.parent[k]]
                owner[d] = t if owner[d] == -1 or owner[d] == t else -2
    keep = np.ones(m, np.bool_)
    best, free = 0, True
    for k in range(m):
        i = ways.parent[k]
        if k == 0 or i != ways.parent[k - 1]:
            best, free = k, misses[i] < 2
            for v in range(V):
                if ways.box[k, v] >= 0 and owner[ways.box[k, v]] == -2:
                    free = False
        keep[k] = k == best or not free or ways.gain[k] >= ways.gain[best] - slack
    return keep


class Conflicts(NamedTuple):
    """What holds between every two of n leaves: conflict (n, n), never both true; together (n, n), log-likelihood ratio of their being one person,
    since they have been near each other."""

    conflict: Mask
    together: Array


class ConflictRows(NamedTuple):
    """Leaves of which bonds are looked for: tree (m,), box (m, V) of each view or −1, place (m, 2) m, over (m,): has ended, missed (m, V):
    log-likelihood of each view showing no box of the person."""

    tree: Ints
    box: Ints
    place: Array
    over: Mask
    missed: Array


@njit(cache=True)
def conflicts_of(old: Conflicts, parent: Ints, rows: ConflictRows, hit: Array, limits: tuple[float, float, float]) -> Conflicts:
    """The bonds of children: those of their parents (−1 for a root, which has none), and those of this tick.

    hit (D,): what each box says for there being somebody. limits: two leaves nearer than so many metres may be one person; how much a tick says for
    that at most; share of what a second box is worth that speaks against it. Who has ended may have gone on as whoever is near now, and is not asked.
    """
    m, V = rows.box.shape
    near, alone, apart = limits
    conflict, together = np.zeros((m, m), np.bool_), np.zeros((m, m))
    for i in range(m):
        if parent[i] >= 0:
            for j in range(m):
                conflict[i, j] = parent[j] >= 0 and old.conflict[parent[i], parent[j]]
        conflict[i, i] = False
    _exclude(rows.tree, conflict)
    for v in range(V):
        _exclude(rows.box[:, v].copy(), conflict)
    for i in range(m):
        for j in range(i + 1, m):
            dx, dy = rows.place[i, 0] - rows.place[j, 0], rows.place[i, 1] - rows.place[j, 1]
            if dx * dx + dy * dy < near * near and not rows.over[i] and not rows.over[j]:
                one, two = 0.0, 0.0
                for v in range(V):
                    if rows.box[i, v] >= 0 and rows.box[j, v] >= 0:
                        two += max(min(hit[rows.box[i, v]], hit[rows.box[j, v]]), 0.0)
                    else:
                        # The farther one may be hidden by the nearer, which is no miss.
                        one -= max(rows.missed[i, v], rows.missed[j, v])
                before = old.together[parent[i], parent[j]] if parent[i] >= 0 and parent[j] >= 0 else 0.0
                together[i, j] = together[j, i] = max(before + min(one, alone) - apart * two, -10.0)
    return Conflicts(conflict, together)


@njit(cache=True)
def _exclude(name: Ints, conflict: Mask) -> None:
    """Those of one name, which is not below 0, exclude each other."""
    order, first = np.argsort(name, kind="mergesort"), 0
    for k in range(1, len(order) + 1):
        if k == len(order) or name[order[k]] != name[order[first]]:
            for i in order[first:k]:
                for j in order[first:k]:
                    conflict[i, j] |= i != j and name[i] >= 0
            first = k


@njit(cache=True)
def max_marginal_losses(weight: Array, conflict: Mask, tree: Ints, best: Ints) -> Array:
    """By how much (n,) the weight of the best hypothesis falls when a leaf must be true: its own tree takes it, and each tree whose best leaf it
    excludes takes the best that it does not. An estimate: those may exclude each other, and others may find room; 0 for the leaves in `best`."""
    n = len(weight)
    out = np.zeros(n)
    first, following = np.full(tree.max() + 1 if n else 0, -1), np.full(n, -1)
    for i in range(n):
        following[i], first[tree[i]] = first[tree[i]], i
    for i in range(n):
        out[i] = -weight[i]
        for u in best:
            if u == i or tree[u] == tree[i]:
                out[i] += weight[u]
            elif conflict[i, u]:
                other, k = 0.0, first[tree[u]]
                while k >= 0:
                    if not conflict[i, k]:
                        other = max(other, weight[k])
                    k = following[k]
                out[i] += weight[u] - other
    return out


@njit(cache=True)
def k_best_per_tree(tree: Ints, box: Ints, state: Array, regret: Array, most: Ints) -> Mask:
    """Which leaves (n,) are kept: of each tree the `most` (n,) of least regret, without those that say what a better one says, too: the same boxes
    now, and nearly the same place and velocity."""
    n = len(tree)
    keep, order = np.zeros(n, np.bool_), np.argsort(regret, kind="mergesort")
    first, following, count = np.full(tree.max() + 1 if n else 0, -1), np.full(n, -1), np.zeros(tree.max() + 1 if n else 0, np.int64)
    for i in order:
        t = tree[i]
        if count[t] >= most[i]:
            continue
        k = first[t]
        while k >= 0:
            d = state[i] - state[k]
            if (box[i] == box[k]).all() and d[0] * d[0] + d[1] * d[1] < 0.15 * 0.15 and d[2] * d[2] + d[3] * d[3] < 0.3 * 0.3:
                break
            k = following[k]
        if k < 0:
            keep[i] = True
            following[i], first[t] = first[t], i
            count[t] += 1
    return keep
