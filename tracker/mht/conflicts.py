"""Conflicts between the leaves of track trees, compiled.

Two leaves are in conflict where they share a tree or a box, or inherit a conflict from their parents (Kim et al. 2015; Papageorgiou & Salpukas 2009).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tracker.geometry import Array, Ints, Mask
from tracker.geometry.compilation import njit


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


class MergeLimits(NamedTuple):
    """`merge_distance` m in this crowd, `merge_step` and `split_share` of the parameters."""

    distance: float
    step: float
    split_share: float


@njit(cache=True)
def conflicts_of(old: Conflicts, parent: Ints, rows: ConflictRows, existence_ratio: Array, limits: MergeLimits) -> Conflicts:
    """The conflicts of children: those of their parents (−1 for a root, which has none), and those of this tick.

    existence_ratio (D,): as in BoxTable.
    Deleted leaves are not taken for one person with another: any near leaf may continue them.
    """
    m, V = rows.box.shape
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
            if dx * dx + dy * dy < limits.distance * limits.distance and not rows.deleted[i] and not rows.deleted[j]:
                one, two = 0.0, 0.0
                for v in range(V):
                    if rows.box[i, v] >= 0 and rows.box[j, v] >= 0:
                        two += max(min(existence_ratio[rows.box[i, v]], existence_ratio[rows.box[j, v]]), 0.0)
                    else:
                        # The nearer one may occlude the other, which is no missed detection.
                        one -= max(rows.missed[i, v], rows.missed[j, v])
                before = old.same_person[parent[i], parent[j]] if parent[i] >= 0 and parent[j] >= 0 else 0.0
                same_person[i, j] = same_person[j, i] = max(before + min(one, limits.step) - limits.split_share * two, -10.0)
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
