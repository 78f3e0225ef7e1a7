"""Child hypotheses of track trees, compiled: the boxes that each leaf may take at a tick, and the combinations that are kept.

The order is that of multiple hypothesis tracking (Kim et al. 2015, Multiple Hypothesis Tracking Revisited, section 3): measurement prediction,
gate, log-likelihood, children of each leaf. Last comes the joint assignment of boxes to the leaves of one global hypothesis.

A leaf takes at most one box a view. A beam search goes through the views, the one that localizes the person best first.
In each view a partial child is updated by each box within its gate, or by none, and the best few are kept.
Each update shrinks the covariance, so that the gates of the remaining views tighten.
"""

from __future__ import annotations

import itertools
import math
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import linear_sum_assignment

from tracker.detections.ground_points import GroundDetections
from tracker.geometry import Array, Ints, Mask
from tracker.geometry.compilation import njit
from tracker.geometry.ground import Ground
from tracker.mht.track_trees import TrackHypotheses
from tracker.tracks.sensor_model import SensorModel

MAX_GATED = 12
"""Boxes of a view within the gate of a leaf, at most; those of the highest log-likelihood ratio are kept."""

NARROW_BEAM = 2
"""Width of the beam where only the best child without certain boxes is wanted."""

NO_ALTERNATIVE = 50.0
"""Log-likelihood ratio of a box over none, where every child of a leaf takes a box of that view."""


# Data


class ParentHypotheses(NamedTuple):
    """The n leaves of all track trees, predicted to a tick.

    state (n, 4) m, m/s, covariance (n, 4, 4); z (n,) m and slope (n, 2) of the ground there. missed (n, V): log-likelihood of a missed detection
    in each view. deleted (n,): a deleted track, which takes no box. tree (n,): its id.
    appearance (n, D): log-likelihood ratio of each box by the appearance model.
    """

    state: Array
    covariance: Array
    z: Array
    slope: Array
    missed: Array
    deleted: Mask
    tree: Ints
    appearance: Array

    @staticmethod
    def of(leaves: TrackHypotheses, ground: Ground, missed: Array, appearance: Array) -> ParentHypotheses:
        """Predicted leaves with the ground under them."""
        place = leaves.state[:, :2]
        around = [np.array([0.1, 0.0]), np.array([0.0, 0.1])]
        slope = np.stack([(ground.height_at(place + e) - ground.height_at(place - e)) / 0.2 for e in around], axis=1)
        return ParentHypotheses(leaves.state, leaves.covariance, ground.height_at(place), slope, missed, leaves.deleted, leaves.tree, appearance)


class BoxTable(NamedTuple):
    """The D boxes of all V views in one table; those of view v are rows start[v] to start[v + 1].

    Of the views: origin (V, 3) m; bias (V, 6), the registration bias about `centre` (2,) m as in RegistrationBias.of.
    Of the boxes: direction (D, 3) to the feet and covariance (D, 2, 2) rad²; feet_hidden (D,): probability that the box ends above the feet.
    head_slope (D,): tangent of the elevation of the upper edge; usable (D,): confident enough.
    detection_ratio (D,): log of the detection rate over the density of false boxes a steradian. existence_ratio (D,): log-likelihood ratio of a
    person over clutter, whatever the direction.
    """

    origin: Array
    bias: Array
    centre: Array
    start: Ints
    direction: Array
    covariance: Array
    feet_hidden: Array
    head_slope: Array
    detection_ratio: Array
    existence_ratio: Array
    usable: Mask

    @staticmethod
    def of(views: list[GroundDetections], sensors: SensorModel, clutter: float) -> BoxTable:
        """clutter: least density of false boxes of a view, a steradian."""
        q = sensors.parameters

        def column(name: str, shape: tuple[int, ...]) -> Array:
            return np.concatenate([np.zeros((0, *shape)), *(getattr(f, name) for f in views)])

        start = np.cumsum([0, *(len(f) for f in views)])
        bias = np.array([sensors.registration_bias.of(f.camera) for f in views]).reshape(-1, 6)
        origin = np.array([f.origin for f in views]).reshape(-1, 3)
        most = [np.log(sensors.detection(f.camera) / clutter) for f in views]
        ratio = np.concatenate([np.zeros(0), *(np.minimum(sensors.detection_log_ratio(f), m) for f, m in zip(views, most, strict=True))])
        existence = np.concatenate([np.zeros(0), *(sensors.detection_rates.log_ratio(f.camera, f.confidence) for f in views)])
        return BoxTable(
            origin, bias, sensors.registration_bias.centre, start, column("direction", (3,)), column("covariance", (2, 2)), column("feet_hidden", ()),
            np.tan(column("head_elevation", ())), ratio, np.minimum(existence, q.max_gain), column("confidence", ()) >= q.min_confidence,
        )  # fmt: skip


class BranchingConstants(NamedTuple):
    """What bounds the children of a leaf.

    gate: standard deviations; foot_spread m; min_height, max_height m of a person. missed_by_all: least log-likelihood of missed detections in all
    views at once. min_ratio: least log-likelihood ratio of a box. margin: log-likelihood by which a child may be worse than the best one.
    beam_width, max_children: partial children and children that are kept.
    """

    gate: float
    foot_spread: float
    min_height: float
    max_height: float
    missed_by_all: float
    min_ratio: float
    margin: float
    beam_width: int
    max_children: int


class ChildHypotheses(NamedTuple):
    """m children, grouped by parent, the best first and the one without any box last.

    parent (m,): row of the leaf; box (m, V): rows of BoxTable or −1. increment (m,) of the track score, of which missed (m,) comes from views
    without a box; state (m, 4), covariance (m, 4, 4). residual (m, V, 2) rad, H and S (m, V, 2, 2): innovations, NaN without feet.
    """

    parent: Ints
    box: Ints
    increment: Array
    missed: Array
    state: Array
    covariance: Array
    residual: Array
    H: Array
    S: Array


@njit(cache=True)
def empty_children(m: int, V: int) -> Any:
    """The columns of m ChildHypotheses before V views, without any box."""
    return (
        np.zeros(m, np.int64), np.full((m, V), -1, np.int64), np.zeros(m), np.zeros(m), np.zeros((m, 4)), np.zeros((m, 4, 4)),
        np.full((m, V, 2), np.nan), np.zeros((m, V, 2, 2)), np.zeros((m, V, 2, 2)),
    )  # fmt: skip


# Measurement prediction


@njit(cache=True)
def predict_measurement(x: Array, z: float, slope: Array, origin: Array, out: Array) -> None:
    """Predicted direction from `origin` to the feet of a person at x, on ground of height z and such a slope.

    out[0:3] direction; [3:6], [6:9] basis of its tangent plane; [9:13] H row by row; [13] distance m; [14] horizontal distance m;
    [15] rad that a body reaches up.
    """
    sx, sy, sz = x[0] - origin[0], x[1] - origin[1], z - origin[2]
    d = max(math.sqrt(sx * sx + sy * sy + sz * sz), 0.2)
    ex, ey, ez = sx / d, sy / d, sz / d
    across = max(math.hypot(ex, ey), 1e-9)
    ax, ay = -ey / across, ex / across
    ux, uy, uz = -ez * ay, ez * ax, ex * ay - ey * ax
    out[0], out[1], out[2] = ex, ey, ez
    out[3], out[4], out[5] = ax, ay, 0.0
    out[6], out[7], out[8] = ux, uy, uz
    out[9], out[10] = ax / d, ay / d
    out[11], out[12] = (ux + uz * slope[0]) / d, (uy + uz * slope[1]) / d
    out[13], out[14], out[15] = d, math.hypot(sx, sy), math.atan2(1.2, d)


@njit(cache=True)
def innovation_covariance(predicted: Array, P: Array, spread: float) -> tuple[float, float, float]:
    """H (P + spread² I) Hᵀ as its entries 00, 01, 11."""
    p, q, r = P[0, 0] + spread * spread, P[0, 1], P[1, 1] + spread * spread
    a, b, c, d = predicted[9], predicted[10], predicted[11], predicted[12]
    return a * a * p + 2 * a * b * q + b * b * r, a * c * p + (a * d + b * c) * q + b * d * r, c * c * p + 2 * c * d * q + d * d * r


# Gate


@njit(cache=True)
def gate(v: int, i: int, parents: Any, boxes: Any, limits: Any, gated: Ints) -> int:
    """Rows of the boxes of view v within the gate of the predicted leaf i, into `gated` (MAX_GATED,); how many."""
    predicted = np.empty(16)
    predict_measurement(parents.state[i], parents.z[i], parents.slope[i], boxes.origin[v], predicted)
    S0 = innovation_covariance(predicted, parents.covariance[i], limits.foot_spread)
    found, ratios = 0, np.empty(MAX_GATED)
    for d in range(boxes.start[v], boxes.start[v + 1]):
        if not boxes.usable[d]:
            continue
        direction = boxes.direction[d]
        if predicted[0] * direction[0] + predicted[1] * direction[1] + predicted[2] * direction[2] < 0.5:
            continue
        height = boxes.origin[v, 2] - parents.z[i] + predicted[14] * boxes.head_slope[d]
        slack = 0.15 + 0.02 * predicted[13]
        if not limits.min_height - slack < height < limits.max_height + slack:
            continue
        ratio = log_likelihood(predicted, S0, v, d, boxes, limits.gate) + parents.appearance[i, d]
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
def _gate_all(parents: Any, boxes: Any, limits: Any) -> tuple[Any, Mask]:
    """Boxes (n, V, MAX_GATED) within the gate of each leaf, −1 after the last; and which boxes (D,) are in the gates of several trees."""
    V, D = len(boxes.origin), len(boxes.usable)
    gated, owner = np.full((len(parents.state), V, MAX_GATED), -1), np.full(D, -1)
    for i in range(len(parents.state)):
        if parents.deleted[i]:
            continue
        for v in range(V):
            for k in range(gate(v, i, parents, boxes, limits, gated[i, v])):
                d, t = gated[i, v, k], parents.tree[i]
                owner[d] = t if owner[d] == -1 or owner[d] == t else -2
    return gated, owner == -2


# Log-likelihood and update


@njit(cache=True)
def log_likelihood(predicted: Array, S0: tuple[float, float, float], v: int, d: int, boxes: Any, gate: float) -> float:
    """Log-likelihood ratio of box d of view v over clutter; −inf outside the gate. S0: covariance of the predicted measurement."""
    r0, r1 = _residual(predicted, v, d, boxes)
    C = boxes.covariance[d]
    box = boxes.detection_ratio[d], boxes.feet_hidden[d]
    return _log_ratio(r0, r1, (S0[0] + C[0, 0], S0[1] + C[0, 1], S0[2] + C[1, 1]), predicted, box, gate)[0]


@njit(cache=True)
def _residual(predicted: Array, v: int, d: int, boxes: Any) -> tuple[float, float]:
    """Innovation of box d of view v in the tangent plane of the predicted direction, without the view's registration bias."""
    direction, origin, bias = boxes.direction[d], boxes.origin[v], boxes.bias[v]
    x, y = origin[0] + predicted[13] * predicted[0] - boxes.centre[0], origin[1] + predicted[13] * predicted[1] - boxes.centre[1]
    dx, dy = bias[0] + bias[2] * x + bias[3] * y, bias[1] + bias[4] * x + bias[5] * y
    r0 = predicted[3] * direction[0] + predicted[4] * direction[1]
    r1 = predicted[6] * direction[0] + predicted[7] * direction[1] + predicted[8] * direction[2]
    return r0 - predicted[9] * dx - predicted[10] * dy, r1 - predicted[11] * dx - predicted[12] * dy


@njit(cache=True)
def _log_ratio(r0: float, r1: float, S: tuple[float, float, float], predicted: Array, box: tuple[float, float], gate: float) -> tuple[float, bool]:
    """Log-likelihood ratio of an innovation over clutter, −inf outside the gate; and whether the feet are taken as visible.

    box: `detection_ratio` and `feet_hidden` of it.
    """
    a, b, c = S
    det = a * c - b * b
    both = (c * r0 * r0 - 2 * b * r0 * r1 + a * r1 * r1) / det
    side = r0 * r0 / a
    detection_ratio, feet_hidden = box
    visible = detection_ratio + math.log(1 - feet_hidden) - 0.5 * (both + math.log(39.4784176 * det)) if both <= gate * gate else -np.inf
    # Where the feet are hidden, the lower edge is uniform from the predicted feet upwards, over the height of the body.
    body = predicted[15]
    hidden = -np.inf
    if side <= gate * gate and -2 * math.sqrt(c) < r1 < body:
        hidden = detection_ratio + math.log(feet_hidden / body) - 0.5 * (side + math.log(6.28318531 * a))
    return max(visible, hidden), visible >= hidden


@njit(cache=True)
def update_child(k: int, i: int, v: int, d: int, parents: Any, boxes: Any, limits: Any, children: Any) -> float:
    """Update child k of leaf i by box d of view v, in place; its log-likelihood ratio."""
    predicted = np.empty(16)
    predict_measurement(children.state[k], parents.z[i], parents.slope[i], boxes.origin[v], predicted)
    S0 = innovation_covariance(predicted, children.covariance[k], limits.foot_spread)
    r0, r1 = _residual(predicted, v, d, boxes)
    C = boxes.covariance[d]
    S = (S0[0] + C[0, 0], S0[1] + C[0, 1], S0[2] + C[1, 1])
    ratio, visible = _log_ratio(r0, r1, S, predicted, (boxes.detection_ratio[d], boxes.feet_hidden[d]), limits.gate)
    _kalman_update(children.state[k], children.covariance[k], predicted, (r0, r1), S, 2 if visible else 1)
    children.box[k, v] = d
    if visible:
        H = children.H[k, v]
        children.residual[k, v, 0], children.residual[k, v, 1] = r0, r1
        H[0, 0], H[0, 1], H[1, 0], H[1, 1] = predicted[9], predicted[10], predicted[11], predicted[12]
        children.S[k, v, 0, 0], children.S[k, v, 1, 1] = S[0], S[2]
        children.S[k, v, 0, 1] = children.S[k, v, 1, 0] = S[1]
    return ratio + parents.appearance[i, d]


@njit(cache=True)
def _kalman_update(x: Array, P: Array, predicted: Array, r: tuple[float, float], S: tuple[float, float, float], m: int) -> None:
    """The Kalman update of x (4,), P (4, 4) in place, by the first m components of the innovation r with covariance S, entries 00, 01, 11."""
    a, b, c, d = predicted[9], predicted[10], predicted[11], predicted[12]
    old = (
        (P[0, 0], P[0, 1], P[0, 2], P[0, 3]), (P[1, 0], P[1, 1], P[1, 2], P[1, 3]),
    )  # fmt: skip
    det = S[0] * S[2] - S[1] * S[1]
    for i in range(4):
        p0 = a * old[0][i] + b * old[1][i]
        p1 = c * old[0][i] + d * old[1][i]
        k0, k1 = p0 / S[0], 0.0
        if m == 2:
            k0, k1 = (p0 * S[2] - p1 * S[1]) / det, (p1 * S[0] - p0 * S[1]) / det
        x[i] += k0 * r[0] + k1 * r[1]
        for j in range(i, 4):
            P[i, j] -= k0 * (a * old[0][j] + b * old[1][j]) + k1 * (c * old[0][j] + d * old[1][j])
            P[j, i] = P[i, j]


# Children of each leaf


@njit(cache=True)
def branch(parents: ParentHypotheses, boxes: BoxTable, limits: BranchingConstants) -> ChildHypotheses:
    """The children of all leaves at this tick; the last child of each leaf has no box.

    A box of the best child that other trees gate, too, is forbidden in turn, and then all such boxes at once. The best child without
    the forbidden boxes is added unless a child avoids them already. So a child is left whatever other trees take.
    """
    V = len(boxes.origin)
    out = ChildHypotheses(*empty_children(len(parents.state) * (limits.max_children + V + 2), V))
    beam, narrow = ChildHypotheses(*empty_children(limits.beam_width, V)), ChildHypotheses(*empty_children(min(limits.beam_width, NARROW_BEAM), V))
    gated, contested = _gate_all(parents, boxes, limits)
    banned = np.zeros(len(boxes.usable), np.bool_)
    m = 0
    for i in range(len(parents.state)):
        if not parents.deleted[i]:
            count, start = _beam_search(i, parents, boxes, limits, gated[i], banned, beam), m
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
                    count = _beam_search(i, parents, boxes, limits, gated[i], banned, narrow)
                    b = int(np.argmax(narrow.increment[:count]))
                    if narrow.increment[b] >= least:
                        m = _append(out, m, start, i, narrow, b)
                banned[:] = False
        out.parent[m], out.state[m], out.covariance[m] = i, parents.state[i], parents.covariance[i]
        # Missed detections in all views at once have one cause, and count as a few.
        out.increment[m] = 0.0 if parents.deleted[i] else max(parents.missed[i].sum(), limits.missed_by_all)
        out.missed[m] = out.increment[m]
        m += 1
    return ChildHypotheses(
        out.parent[:m].copy(), out.box[:m].copy(), out.increment[:m].copy(), out.missed[:m].copy(), out.state[:m].copy(), out.covariance[:m].copy(),
        out.residual[:m].copy(), out.H[:m].copy(), out.S[:m].copy(),
    )  # fmt: skip


@njit(cache=True)
def _beam_search(i: int, parents: Any, boxes: Any, limits: Any, gated: Ints, banned: Mask, beam: Any) -> int:
    """Children of leaf i into the arrays of `beam`, unordered, as many as it has rows at most; how many.

    gated (V, MAX_GATED): boxes within its gate, −1 after the last; banned (D,): boxes that it must not take.
    """
    size, predicted = len(beam.increment) * (MAX_GATED + 1), np.empty(16)
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
            predict_measurement(beam.state[b], parents.z[i], parents.slope[i], boxes.origin[v], predicted)
            S0 = innovation_covariance(predicted, beam.covariance[b], limits.foot_spread)
            for d in gated[v]:
                if d < 0 or banned[d]:
                    continue
                ratio = log_likelihood(predicted, S0, v, d, boxes, limits.gate) + parents.appearance[i, d]
                if ratio > max(missed - limits.margin, limits.min_ratio):
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
    """Views in the order of how well they localize leaf i: distance² over height, by which an angle grows on the ground, ascending."""
    V = len(boxes.origin)
    key = np.empty(V)
    for v in range(V):
        dx, dy = parents.state[i, 0] - boxes.origin[v, 0], parents.state[i, 1] - boxes.origin[v, 1]
        key[v] = (dx * dx + dy * dy) / max(boxes.origin[v, 2] - parents.z[i], 0.1)
    return np.argsort(key, kind="mergesort")


@njit(cache=True)
def _append(out: Any, m: int, start: int, i: int, beam: Any, b: int) -> int:
    """Child b of leaf i into row m, unless it takes no box or is among rows start to m; the next free row."""
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
    """Whether one of the children with boxes (k, V) takes none that is banned."""
    for k in range(len(box)):
        free = True
        for v in range(box.shape[1]):
            free = free and (box[k, v] < 0 or not banned[box[k, v]])
        if free:
            return True
    return False


# Joint assignment


def assign_jointly(rows: Ints, parents: ParentHypotheses, boxes: BoxTable, limits: BranchingConstants) -> tuple[ChildHypotheses, Array]:
    """One child for each leaf in `rows` (k,) of a global hypothesis, by a 2-D assignment of boxes to leaves in one view after another.

    Children that are found leaf by leaf are rarely compatible where people stand close together in many views.
    Also returned: the log-likelihood ratio (k, D) of each box over a missed detection, 0 where it is not taken.
    """
    k, V = len(rows), len(boxes.origin)
    out, ratio = ChildHypotheses(*empty_children(k, V)), np.zeros((k, len(boxes.usable)))
    out.parent[:] = rows
    out.state[:], out.covariance[:] = parents.state[rows], parents.covariance[rows]
    for v in _joint_view_order(rows, parents, boxes):
        over_none = np.maximum(_pairwise_ratios(v, rows, parents, boxes, limits, out) - parents.missed[rows, v, None], 0.0)
        ratio[:, boxes.start[v] : boxes.start[v + 1]] = over_none
        i, d = _assign(over_none)
        box = np.full(k, -1)
        box[i] = d + boxes.start[v]
        _update_all(v, box, parents, boxes, limits, out)
    return out, ratio


def assigned_boxes(rows: Ints, children: ChildHypotheses, boxes: BoxTable) -> Mask:
    """Which boxes (D,) the leaves in `rows` take: a 2-D assignment in each view, by the best child of each leaf with each box."""
    place = np.full(max(children.parent.max(initial=-1), rows.max(initial=-1)) + 1, -1)
    place[rows] = np.arange(len(rows))
    mine = place[children.parent] >= 0
    row, box, increment = place[children.parent[mine]], children.box[mine], children.increment[mine]
    out = np.zeros(len(boxes.usable), dtype=bool)
    for v, (start, end) in enumerate(itertools.pairwise(boxes.start.tolist())):
        best = np.full((len(rows), end - start + 1), -np.inf)
        np.maximum.at(best, (row, np.where(box[:, v] >= 0, box[:, v] - start, -1)), increment)
        # Where every child of a leaf takes a box of this view, the leaf takes one of them.
        none = np.maximum(best[:, -1:], best.max(axis=1, keepdims=True) - NO_ALTERNATIVE)
        out[start + _assign(np.maximum(best[:, :-1] - none, 0.0))[1]] = True
    return out


def union(children: ChildHypotheses, others: ChildHypotheses) -> ChildHypotheses:
    """`children` and those of `others` with a box that are not among them, in the order of ChildHypotheses."""
    known = {(p, *b) for p, b in zip(children.parent.tolist(), children.box.tolist(), strict=True)}
    found = [(p, *b) not in known and max(b, default=-1) >= 0 for p, b in zip(others.parent.tolist(), others.box.tolist(), strict=True)]
    new = np.flatnonzero(found)
    if not len(new):
        return children
    both = ChildHypotheses._make(np.concatenate([a, b[new]]) for a, b in zip(children, others, strict=True))
    rows = np.lexsort((-both.increment, (both.box < 0).all(axis=1), both.parent))
    return ChildHypotheses._make(column[rows] for column in both)


def _assign(ratio: Array) -> tuple[Ints, Ints]:
    """Rows and columns (m,) of the assignment of the largest sum; ratio (k, d) of each box over none, 0 where it is not taken."""
    rows, boxes = linear_sum_assignment(ratio, maximize=True)
    taken = ratio[rows, boxes] > 0
    return rows[taken], boxes[taken]


@njit(cache=True)
def _joint_view_order(rows: Ints, parents: Any, boxes: Any) -> Ints:
    """Views in the order of their summed ranks in `view_order` of the leaves in `rows`."""
    rank = np.zeros(len(boxes.origin))
    for i in rows:
        rank[view_order(i, parents, boxes)] += np.arange(len(rank))
    return np.argsort(rank, kind="mergesort")


@njit(cache=True)
def _pairwise_ratios(v: int, rows: Ints, parents: Any, boxes: Any, limits: Any, children: Any) -> Array:
    """Log-likelihood ratio (k, d) of each box of view v for the partial child of each leaf in `rows`; −inf where it is not taken."""
    first, end = boxes.start[v], boxes.start[v + 1]
    out, predicted, gated = np.full((len(rows), end - first), -np.inf), np.empty(16), np.empty(MAX_GATED, np.int64)
    for k, i in enumerate(rows):
        found = gate(v, i, parents, boxes, limits, gated)
        predict_measurement(children.state[k], parents.z[i], parents.slope[i], boxes.origin[v], predicted)
        S0 = innovation_covariance(predicted, children.covariance[k], limits.foot_spread)
        for d in gated[:found]:
            ratio = log_likelihood(predicted, S0, v, d, boxes, limits.gate) + parents.appearance[i, d]
            if ratio > 0.0:
                out[k, d - first] = ratio
    return out


@njit(cache=True)
def _update_all(v: int, box: Ints, parents: Any, boxes: Any, limits: Any, children: Any) -> None:
    """Update each partial child, in place, by its box (k,) of view v, −1 for a missed detection."""
    for k in range(len(box)):
        i, d = children.parent[k], box[k]
        if d < 0:
            children.increment[k] += parents.missed[i, v]
            children.missed[k] += parents.missed[i, v]
            continue
        children.increment[k] += update_child(k, i, v, d, parents, boxes, limits, children)
