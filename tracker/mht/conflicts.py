"""Conflicts between the leaves of track trees, compiled; and the pruning of children and leaves that rests on them.

Two leaves are in conflict where they share a tree or a box, or inherit a conflict from their parents (Kim et al. 2015; Papageorgiou & Salpukas 2009).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from tracker.geometry import Array, Ints, Mask
from tracker.mht.branching import ChildHypotheses


class Conflicts(NamedTuple):
    """Relations of every two of n leaves: conflict (n, n), never both true; same_person (n, n), log-likelihood ratio of their being one person."""

    conflict: Mask
    same_person: Array


class ConflictRows(NamedTuple):
    """What conflicts of m leaves come from: tree (m,); box (m, V) of each view or −1; place (m, 2) m; deleted (m,); missed (m, V):
    log-likelihood of a missed detection in each view."""

    tree: Ints
    box: Ints
    place: Array
    deleted: Mask
    missed: Array


@njit(cache=True)
def conflicts_of(old: Conflicts, parent: Ints, rows: ConflictRows, existence_ratio: Array, limits: tuple[float, float, float]) -> Conflicts:
    """The conflicts of children: those of their parents (−1 for a root, which has none), and those of this tick.

    existence_ratio (D,): as in BoxTable. limits: `merge_distance`, `merge_step`, `split_share` of the parameters.
    Deleted leaves are not taken for one person with another: any near leaf may continue them.
    """
    m, V = rows.box.shape
    merge_distance, merge_step, split_share = limits
    conflict, same_person = np.zeros((m, m), np.bool_), np.zeros((m, m))
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
            if dx * dx + dy * dy < merge_distance * merge_distance and not rows.deleted[i] and not rows.deleted[j]:
                one, two = 0.0, 0.0
                for v in range(V):
                    if rows.box[i, v] >= 0 and rows.box[j, v] >= 0:
                        two += max(min(existence_ratio[rows.box[i, v]], existence_ratio[rows.box[j, v]]), 0.0)
                    else:
                        # The nearer one may occlude the other, which is no missed detection.
                        one -= max(rows.missed[i, v], rows.missed[j, v])
                before = old.same_person[parent[i], parent[j]] if parent[i] >= 0 and parent[j] >= 0 else 0.0
                same_person[i, j] = same_person[j, i] = max(before + min(one, merge_step) - split_share * two, -10.0)
    return Conflicts(conflict, same_person)


@njit(cache=True)
def _exclude(label: Ints, conflict: Mask) -> None:
    """Set the conflicts, in place, of rows with one label (m,) of 0 or more."""
    order, first = np.argsort(label, kind="mergesort"), 0
    for k in range(1, len(order) + 1):
        if k == len(order) or label[order[k]] != label[order[first]]:
            for i in order[first:k]:
                for j in order[first:k]:
                    conflict[i, j] |= i != j and label[i] >= 0
            first = k


@njit(cache=True)
def prune_branches(children: ChildHypotheses, tree: Ints, misses: Ints, margin: float, boxes: int) -> Mask:
    """Which children (m,) are kept: those within `margin` of the best child of their leaf.

    All are kept where the best one takes a box that other trees want, too. So are those of a leaf without a box for two ticks.
    tree, misses: of the parents; boxes: their number.
    """
    m, V = children.box.shape
    owner = np.full(boxes, -1, np.int64)
    for k in range(m):
        for v in range(V):
            d = children.box[k, v]
            if d >= 0:
                t = tree[children.parent[k]]
                owner[d] = t if owner[d] == -1 or owner[d] == t else -2
    keep = np.ones(m, np.bool_)
    best, uncontested = 0, True
    for k in range(m):
        i = children.parent[k]
        if k == 0 or i != children.parent[k - 1]:
            best, uncontested = k, misses[i] < 2
            for v in range(V):
                if children.box[k, v] >= 0 and owner[children.box[k, v]] == -2:
                    uncontested = False
        keep[k] = k == best or not uncontested or children.increment[k] >= children.increment[best] - margin
    return keep


@njit(cache=True)
def max_marginal_losses(weight: Array, conflict: Mask, tree: Ints, best: Ints) -> Array:
    """Estimated loss (n,) of the global hypothesis `best` (rows) where it must hold a leaf; 0 for those that it holds.

    The tree of the leaf takes that leaf. Each tree whose leaf in `best` is in conflict with it takes its best leaf that is not.
    The estimate ignores conflicts among those, and leaves that would become free.
    """
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
def k_best_per_tree(tree: Ints, box: Ints, state: Array, loss: Array, most: Ints) -> Mask:
    """Which leaves (n,) are kept: the `most` (n,) of smallest loss (n,) of each tree.

    A leaf is dropped where a better one of its tree has the same boxes at this tick, and nearly the same place and velocity.
    """
    n = len(tree)
    keep, order = np.zeros(n, np.bool_), np.argsort(loss, kind="mergesort")
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
