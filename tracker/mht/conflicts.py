"""Conflicts between the leaves of track trees, compiled.

Two leaves are in conflict where they share a tree or a box, or inherit a conflict from their parents (Kim et al. 2015; Papageorgiou & Salpukas 2009).
Leaves also conflict while they are too near each other for two bodies. Otherwise second boxes of one person would get a track.
"""

from __future__ import annotations

import math

import numpy as np

from tracker.geometry import Array, Ints, Mask
from tracker.geometry.compilation import njit
from tracker.mht.track_trees import TrackHypotheses


@njit(cache=True)
def conflicts_of(old: Mask, parent: Ints, tree: Ints, box: Ints) -> Mask:
    """Which pairs of m leaves (m, m) exclude each other, through their parents (−1 for a root, which has none) or at this tick.

    old (n, n): conflicts of the leaves of the last tick. tree (m,); box (m, V): the box of each view, or −1.
    """
    m, V = box.shape
    conflict = np.zeros((m, m), np.bool_)
    for i in range(m):
        if parent[i] >= 0:
            for j in range(m):
                conflict[i, j] = parent[j] >= 0 and old[parent[i], parent[j]]
        conflict[i, i] = False
    _exclude(tree, conflict)
    for v in range(V):
        _exclude(box[:, v].copy(), conflict)
    return conflict


def of_one_body(leaves: TrackHypotheses, least: float) -> Mask:
    """Which pairs of n leaves (n, n) are too near for two bodies: their mean distance over the ticks that both remember is below `least` m.

    Deleted leaves have no body: they stay for the smoother alone.
    """
    return np.asarray(_too_near(leaves.tree, leaves.state, leaves.states, leaves.age, least)) & ~(leaves.deleted[:, None] | leaves.deleted)


@njit(cache=True)
def _too_near(tree: Ints, state: Array, states: Array, age: Ints, least: float) -> Mask:
    """`of_one_body` for trees (n,), states (n, 5), remembered states (n, T, 5), the latest first, and ages (n,) in ticks."""
    n, window = states.shape[:2]
    out = np.zeros((n, n), np.bool_)
    for i in range(n):
        for j in range(i + 1, n):
            if tree[i] == tree[j] or math.hypot(state[i, 0] - state[j, 0], state[i, 1] - state[j, 1]) >= 2 * least:
                continue
            both, apart = min(age[i], age[j], window), 0.0
            for t in range(both):
                apart += math.hypot(states[i, t, 0] - states[j, t, 0], states[i, t, 1] - states[j, t, 1])
            out[i, j] = out[j, i] = apart < least * both
    return out


@njit(cache=True)
def _exclude(label: Ints, conflict: Mask) -> None:
    """Mark rows of equal label (m,) as conflicting, in place; negative labels are none."""
    order, first = np.argsort(label, kind="mergesort"), 0
    for k in range(1, len(order) + 1):
        if k == len(order) or label[order[k]] != label[order[first]]:
            for i in order[first:k]:
                for j in order[first:k]:
                    conflict[i, j] |= i != j and label[i] >= 0
            first = k
