"""Child hypotheses of track trees, compiled: the boxes that each leaf may take at a tick, and the combinations that are kept.

The order is that of multiple hypothesis tracking (Kim et al. 2015, Multiple Hypothesis Tracking Revisited, section 3): measurement prediction,
gate, log-likelihood, children of each leaf. The joint assignment of boxes to the leaves of one global hypothesis follows.

A leaf takes at most one box per view. A beam search visits the views, the one that localizes the person best first.
In each view a partial child is updated by each box within its gate, or by none, and the best few are kept.
Each update shrinks the covariance, so that the gates of the remaining views tighten.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from tracker.geometry import Array, Ints, Mask
from tracker.geometry.compilation import njit
from tracker.mht.box_update import PREDICTED, log_likelihood, predict_measurement, update_child
from tracker.mht.branching_data import BoxTable, BranchingConstants, ChildHypotheses, ParentHypotheses, empty_children

MAX_GATED = 12
"""Greatest number of boxes of a view in the gate of a leaf; those of the highest log-likelihood ratio are kept."""

NARROW_BEAM = 2
"""Width of the beam where only the best child without certain boxes is wanted."""


@njit(cache=True)
def gate(v: int, i: int, parents: Any, boxes: Any, limits: Any, gated: Ints, ratios: Array) -> int:
    """Write rows and log-likelihood ratios of the boxes of view v in the gate of leaf i to `gated`, `ratios` (MAX_GATED,); return their number."""
    predicted, x, P = np.empty(PREDICTED), parents.state[i], parents.covariance[i]
    predict_measurement(x, i, parents, v, boxes, predicted)
    found = 0
    for d in range(boxes.start[v], boxes.start[v + 1]):
        direction = boxes.direction[d]
        if predicted[0] * direction[0] + predicted[1] * direction[1] + predicted[2] * direction[2] < 0.5:
            continue
        ratio = log_likelihood(predicted, x, P, v, d, boxes, limits) + parents.links[i, d]
        if ratio == -np.inf:
            continue
        if found < MAX_GATED:
            gated[found], ratios[found] = d, ratio
            found += 1
        else:
            k = np.argmin(ratios)
            if ratio > ratios[k]:
                gated[k], ratios[k] = d, ratio
    return found


@njit(cache=True)
def child_ratios(b: int, i: int, v: int, parents: Any, boxes: Any, limits: Any, children: Any, gated: Ints, ratios: Array) -> Array:
    """Log-likelihood ratios (MAX_GATED,) of the boxes `gated` of view v, −1 after the last, for the partial child b of leaf i; `ratios` of the leaf.

    A partial child without a box still has the state of its leaf.
    """
    if not (children.box[b] >= 0).any():
        return ratios
    out, predicted = np.empty(MAX_GATED), np.empty(PREDICTED)
    predict_measurement(children.state[b], i, parents, v, boxes, predicted)
    for k, d in enumerate(gated):
        if d >= 0:
            out[k] = log_likelihood(predicted, children.state[b], children.covariance[b], v, d, boxes, limits) + parents.links[i, d]
    return out


@njit(cache=True)
def _gate_all(parents: Any, boxes: Any, limits: Any) -> tuple[Any, Any, Mask]:
    """Boxes (n, V, MAX_GATED) within the gate of each leaf, −1 after the last, their ratios, and which boxes (D,) are in gates of several trees."""
    V, D = len(boxes.origin), len(boxes.cut)
    gated, ratios, owner = np.full((len(parents.state), V, MAX_GATED), -1), np.zeros((len(parents.state), V, MAX_GATED)), np.full(D, -1)
    for i in range(len(parents.state)):
        if parents.deleted[i]:
            continue
        for v in range(V):
            for k in range(gate(v, i, parents, boxes, limits, gated[i, v], ratios[i, v])):
                d, t = gated[i, v, k], parents.tree[i]
                owner[d] = t if owner[d] == -1 or owner[d] == t else -2
    return gated, ratios, owner == -2


@njit(cache=True)
def branch(parents: ParentHypotheses, boxes: BoxTable, limits: BranchingConstants) -> ChildHypotheses:
    """The children of all leaves at this tick; the last child of each leaf has no box.

    A box of the best child is contested if another tree has it in a gate. Contested boxes are forbidden one by one, then all at once. The best
    child without the forbidden boxes is added, unless a child avoids them already. So a child remains whatever boxes other trees take.
    """
    V = len(boxes.origin)
    out = ChildHypotheses(*empty_children(len(parents.state) * (limits.max_children + V + 2), V))
    beam, narrow = ChildHypotheses(*empty_children(limits.beam_width, V)), ChildHypotheses(*empty_children(min(limits.beam_width, NARROW_BEAM), V))
    gated, ratios, contested = _gate_all(parents, boxes, limits)
    banned = np.zeros(len(boxes.cut), np.bool_)
    m = 0
    for i in range(len(parents.state)):
        if not parents.deleted[i]:
            count, start = _beam_search(i, parents, boxes, limits, (gated[i], ratios[i]), banned, beam), m
            ranked = np.argsort(-beam.increment[:count], kind="mergesort")
            least = beam.increment[ranked[0]] - limits.margin
            for b in ranked:
                if m - start < limits.max_children and beam.increment[b] >= least:
                    m = _append(out, m, start, i, beam, b)
            taken = out.box[start].copy() if m > start else np.full(V, -1)
            for v in range(V + 1):
                for w in range(V):
                    if (w == v or v == V) and taken[w] >= 0 and contested[taken[w]]:
                        banned[taken[w]] = True
                if banned.any() and not _any_avoids(out.box[start:m], banned):
                    count = _beam_search(i, parents, boxes, limits, (gated[i], ratios[i]), banned, narrow)
                    b = int(np.argmax(narrow.increment[:count]))
                    if narrow.increment[b] >= least:
                        m = _append(out, m, start, i, narrow, b)
                banned[:] = False
        out.parent[m], out.state[m], out.covariance[m] = i, parents.state[i], parents.covariance[i]
        # Misses in all views at once have a common cause, so their sum is bounded.
        out.increment[m] = 0.0 if parents.deleted[i] else max(parents.missed[i].sum(), limits.missed_by_all)
        out.missed[m] = out.increment[m]
        m += 1
    return ChildHypotheses(
        out.parent[:m].copy(), out.box[:m].copy(), out.increment[:m].copy(), out.missed[:m].copy(), out.state[:m].copy(), out.covariance[:m].copy(),
        out.residual[:m].copy(), out.H[:m].copy(), out.S[:m].copy(),
    )  # fmt: skip


@njit(cache=True)
def _beam_search(i: int, parents: Any, boxes: Any, limits: Any, gates: Any, banned: Mask, beam: Any) -> int:
    """Write the children of leaf i to the rows of `beam`, unordered; return their number, at most that of the rows.

    gates: boxes (V, MAX_GATED) in the gates of the leaf, −1 after the last, and their ratios. banned (D,): boxes that children must not take.
    """
    gated, ratios = gates
    size = len(beam.increment) * (MAX_GATED + 1)
    beam.state[0], beam.covariance[0], beam.increment[0], count = parents.state[i], parents.covariance[i], 0.0, 1
    beam.box[:], beam.residual[:], beam.missed[:] = -1, np.nan, 0.0
    score, source, taken = np.empty(size), np.empty(size, np.int64), np.empty(size, np.int64)
    for v in view_order(i, parents, boxes):
        missed = parents.missed[i, v]
        if gated[v, 0] < 0:
            beam.increment[:count] += missed
            beam.missed[:count] += missed
            continue
        extended = 0
        for b in range(count):
            score[extended], source[extended], taken[extended] = beam.increment[b] + missed, b, -1
            extended += 1
            of_child = child_ratios(b, i, v, parents, boxes, limits, beam, gated[v], ratios[v])
            for k, d in enumerate(gated[v]):
                if d < 0 or banned[d]:
                    continue
                ratio = of_child[k]
                if ratio > missed - limits.margin and ratio + boxes.weakness[d] > limits.least_fit:
                    score[extended], source[extended], taken[extended] = beam.increment[b] + ratio, b, d
                    extended += 1
        chosen = np.argsort(-score[:extended], kind="mergesort")[: len(beam.increment)]
        state, covariance, box = beam.state.copy(), beam.covariance.copy(), beam.box.copy()
        residuals, Hs, Ss, absent = beam.residual.copy(), beam.H.copy(), beam.S.copy(), beam.missed.copy()
        count = len(chosen)
        for q in range(count):
            b, d = source[chosen[q]], taken[chosen[q]]
            beam.state[q], beam.covariance[q], beam.box[q], beam.increment[q] = state[b], covariance[b], box[b], score[chosen[q]]
            beam.residual[q], beam.H[q], beam.S[q] = residuals[b], Hs[b], Ss[b]
            beam.missed[q] = absent[b] + missed if d < 0 else absent[b]
            if d >= 0:
                update_child(q, i, v, d, parents, boxes, limits, beam)
    return count


@njit(cache=True)
def view_order(i: int, parents: Any, boxes: Any) -> Ints:
    """Views by ascending distance² over height, the factor from an angular error to an error of leaf i on the ground: the most accurate first."""
    V = len(boxes.origin)
    key = np.empty(V)
    for v in range(V):
        dx, dy = parents.state[i, 0] - boxes.origin[v, 0], parents.state[i, 1] - boxes.origin[v, 1]
        key[v] = (dx * dx + dy * dy) / max(boxes.origin[v, 2] - parents.z[i], 0.1)
    return np.argsort(key, kind="mergesort")


@njit(cache=True)
def _append(out: Any, m: int, start: int, i: int, beam: Any, b: int) -> int:
    """Copy child b of leaf i to row m, unless it takes no box or is among rows start to m; return the next free row."""
    if not (beam.box[b] >= 0).any():
        return m
    for k in range(start, m):
        if (out.box[k] == beam.box[b]).all():
            return m
    out.parent[m], out.box[m], out.increment[m], out.missed[m] = i, beam.box[b], beam.increment[b], beam.missed[b]
    out.state[m], out.covariance[m], out.residual[m] = beam.state[b], beam.covariance[b], beam.residual[b]
    out.H[m], out.S[m] = beam.H[b], beam.S[b]
    return m + 1


@njit(cache=True)
def _any_avoids(box: Ints, banned: Mask) -> bool:
    """Whether any of the children with boxes (k, V) takes no banned box."""
    for k in range(len(box)):
        free = True
        for v in range(box.shape[1]):
            free = free and (box[k, v] < 0 or not banned[box[k, v]])
        if free:
            return True
    return False
