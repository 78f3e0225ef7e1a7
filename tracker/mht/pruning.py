"""Pruning of track trees: N-scan pruning, deletion, and bounds on the number of children and leaves.

Leaves are ranked by their max-marginal loss: the weight that the global hypothesis would lose if it had to hold the leaf.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.special import logit

from tracker.geometry import Array, Ints, Mask
from tracker.geometry.compilation import njit
from tracker.mht.branching_data import ChildHypotheses
from tracker.mht.global_hypothesis import GlobalHypothesis
from tracker.mht.track_trees import TrackHypotheses
from tracker.tracks.parameters import MhtParameters

PATIENCE = 4
"""Revisits of the cameras for which a tentative track may be outside the global hypothesis."""


class Lifetimes(NamedTuple):
    """Bounds in revisits: of coasting, and of the time outside the global hypothesis for confirmed tracks. scan: ticks of the N-scan window."""

    coasting: float
    unselected: float
    scan: int


def surviving_leaves(leaves: TrackHypotheses, box: Ints, chosen: GlobalHypothesis, longest: Lifetimes, parameters: MhtParameters) -> Mask:
    """Which leaves (n,) are kept: within their lifetimes, consistent with N-scan pruning, and of the smallest loss within the bounds on their number.

    box (n, V): the box that each leaf takes in each view at this tick, or -1.
    """
    q = parameters
    # A tentative track that takes boxes of other tracks is never in the global hypothesis, and would otherwise stay for ever.
    tentative = (leaves.expected_misses < 2.5) & (leaves.existence > logit(q.forget)) & (leaves.unselected <= PATIENCE + 0.5)
    keep = np.where(leaves.confirmed, (leaves.misses <= longest.coasting) & (leaves.unselected <= longest.unselected), tentative)
    keep &= leaves.speed <= q.motion.v_max
    keep &= _within_n_scan(leaves, chosen.best, longest.scan)
    # Ids of trees grow without bound; their ranks among the remaining trees do not.
    _, tree = np.unique(leaves.tree, return_inverse=True)
    loss = max_marginal_losses(np.maximum(leaves.score, 0.0), chosen.conflict, tree, chosen.best)
    loss[chosen.best] = -np.inf
    most = np.where(leaves.confirmed, q.tree_leaves, q.tentative_leaves)
    # Leaves that are dropped already do not count towards the bound of their tree.
    keep &= k_best_per_tree(tree, box, leaves.state, np.where(keep, loss, np.inf), most)
    keep &= (loss < q.max_loss) | ~leaves.confirmed
    if q.k_h > 1:
        keep &= chosen.hypotheses.any(axis=0) | ~leaves.confirmed
    if keep.sum() > q.max_leaves:
        best = np.argsort(np.where(keep, loss, np.inf), kind="stable")[: q.max_leaves]
        keep = np.isin(np.arange(len(keep)), best)
    return np.asarray(keep, dtype=bool)


def _within_n_scan(leaves: TrackHypotheses, best: Ints, n_scan: int) -> Mask:
    """Which leaves (n,) agree with the global hypothesis `best` about the ancestor that their tree had `n_scan` ticks ago."""
    decided = {int(leaves.tree[k]): int(leaves.node[k, n_scan]) for k in best if leaves.confirmed[k]}
    ancestors = zip(leaves.tree.tolist(), leaves.node[:, n_scan].tolist(), strict=True)
    return np.array([decided.get(tree, node) == node for tree, node in ancestors], dtype=bool)


@njit(cache=True)
def prune_branches(children: ChildHypotheses, tree: Ints, misses: Array, margin: float, boxes: int) -> Mask:
    """Which children (m,) are kept: those within `margin` of the best child of their leaf.

    All are kept where the best one takes a box that other trees take, too, and where the leaf had no box for two revisits.
    tree, misses: of the parents; boxes: number of boxes.
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
            best, uncontested = k, misses[i] < 1.5
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
