"""What a leaf of a track tree sees of the boxes of a tick, compiled: expected direction, innovation, likelihood, and Kalman's update by a box.

The inner loops of the track trees, compiled: every way in which a leaf may go on at a tick.

A leaf takes at most one box a view. The views are gone through from the one that places feet best; in each, every way so far is corrected by
every box within the gate, or by none, and the best few ways are kept (a search over combinations with a gate that tightens, as each box makes
the place surer, and a cap).

The way on of leaves that are true together: the boxes of each view are shared out among them.
"""

from __future__ import annotations

import itertools
import math
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from scipy.optimize import linear_sum_assignment

from tracker.detections.ground_points import GroundDetections
from tracker.geometry import Array, Ints, Mask
from tracker.geometry.ground import Ground
from tracker.mht.track_trees import TrackHypotheses
from tracker.tracks.sensor_model import SensorModel

NEAREST = 12
"""Boxes of a view that a leaf looks at, at most."""


class ParentHypotheses(NamedTuple):
    """Leaves predicted to a tick: state (n, 4), covariance (n, 4, 4), ground height z (n,) m and slope (n, 2) there; missed (n, V):
    log-likelihood of each view showing no box of the person; over (n,): has ended; tree (n,); alike (n, D): log-likelihood ratio of each box by
    what images say."""

    state: Array
    covariance: Array
    z: Array
    slope: Array
    missed: Array
    over: Mask
    tree: Ints
    alike: Array

    @staticmethod
    def of(leaves: TrackHypotheses, ground: Ground, missed: Array, alike: Array) -> ParentHypotheses:
        """Leaves that have been predicted, on the ground."""
        place = leaves.state[:, :2]
        around = [np.array([0.1, 0.0]), np.array([0.0, 0.1])]
        slope = np.stack([(ground.height_at(place + e) - ground.height_at(place - e)) / 0.2 for e in around], axis=1)
        return ParentHypotheses(leaves.state, leaves.covariance, ground.height_at(place), slope, missed, leaves.over, leaves.tree, alike)


class BoxTable(NamedTuple):
    """The boxes of all views in one table, those of view v in rows start[v] to start[v + 1]: origin (V, 3) m and offset (V, 6) of the views, about
    `centre` (2,) m (offsets.Offsets); direction (D, 3), covariance (D, 2, 2); lying (D,): how often such a box ends above the feet; head (D,):
    tangent of the upper edge's elevation; certain (D,): log of how often people get a box over the density of false ones; hit (D,): log-likelihood
    ratio, wherever it lies, of there being somebody; usable (D,)."""

    origin: Array
    offset: Array
    centre: Array
    start: Ints
    direction: Array
    covariance: Array
    lying: Array
    head: Array
    certain: Array
    hit: Array
    usable: Mask

    @staticmethod
    def of(views: list[GroundDetections], evidence: SensorModel, clutter: float) -> BoxTable:
        """clutter: false boxes a steradian that each view is taken to have at least."""
        q = evidence.parameters

        def column(name: str, shape: tuple[int, ...]) -> Array:
            return np.concatenate([np.zeros((0, *shape)), *(getattr(f, name) for f in views)])

        start = np.cumsum([0, *(len(f) for f in views)])
        offset = np.array([evidence.offsets.of(f.camera) for f in views]).reshape(-1, 6)
        origin = np.array([f.origin for f in views]).reshape(-1, 3)
        most = [np.log(evidence.detection(f.camera) / clutter) for f in views]
        certain = np.concatenate([np.zeros(0), *(np.minimum(evidence.certain(f), m) for f, m in zip(views, most, strict=True))])
        worth = np.concatenate([np.zeros(0), *(evidence.trust.worth(f.camera, f.confidence) for f in views)])
        return BoxTable(
            origin, offset, evidence.offsets.centre, start, column("direction", (3,)), column("covariance", (2, 2)), column("lying", ()),
            np.tan(column("head_elevation", ())), certain, np.minimum(worth, q.most_gain), column("confidence", ()) >= q.min_confidence,
        )  # fmt: skip


class BranchingConstants(NamedTuple):
    """gate: standard deviations; foot_spread m; low, high: heights m; floor: log-likelihood of all views' losing a person at once; least:
    log-likelihood ratio that a box must have in a way that one leaf goes alone; width: log-likelihood under the best way that is kept; beam,
    most: ways kept meanwhile and at last."""

    gate: float
    foot_spread: float
    low: float
    high: float
    floor: float
    least: float
    width: float
    beam: int
    most: int


class ChildHypotheses(NamedTuple):
    """m ways to go on, those of a leaf together, the best first and the one without any box last: parent (m,) its row, box (m, V) rows of Boxes
    or −1, gain (m,), missed (m,): the part of it that views which took no box have in it; state, covariance; residual (m, V, 2) rad with NaN
    where feet were not taken as seen, H, S (m, V, 2, 2) of the innovations."""

    parent: Ints
    box: Ints
    gain: Array
    missed: Array
    state: Array
    covariance: Array
    residual: Array
    H: Array
    S: Array


@njit(cache=True)
def predict_measurement(x: Array, z: float, slope: Array, origin: Array, out: Array) -> None:
    """Sight from origin to feet at x: out[0:3] direction, [3:6] and [6:9] tangent basis, [9:13] H row by row, [13] distance, [14] across,
    [15] rad that a body reaches up."""
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
def innovation_covariance(look: Array, P: Array, spread: float) -> tuple[float, float, float]:
    """H (P + spread² I) Hᵀ as its entries 00, 01, 11."""
    p, q, r = P[0, 0] + spread * spread, P[0, 1], P[1, 1] + spread * spread
    a, b, c, d = look[9], look[10], look[11], look[12]
    return a * a * p + 2 * a * b * q + b * b * r, a * c * p + (a * d + b * c) * q + b * d * r, c * c * p + 2 * c * d * q + d * d * r


@njit(cache=True)
def _residual(look: Array, v: int, d: int, boxes: Any) -> tuple[float, float]:
    """Residual of box d of view v in the tangent plane of the expected direction, with the view's offset taken off."""
    direction, origin, offset = boxes.direction[d], boxes.origin[v], boxes.offset[v]
    x, y = origin[0] + look[13] * look[0] - boxes.centre[0], origin[1] + look[13] * look[1] - boxes.centre[1]
    dx, dy = offset[0] + offset[2] * x + offset[3] * y, offset[1] + offset[4] * x + offset[5] * y
    r0 = look[3] * direction[0] + look[4] * direction[1]
    r1 = look[6] * direction[0] + look[7] * direction[1] + look[8] * direction[2]
    return r0 - look[9] * dx - look[10] * dy, r1 - look[11] * dx - look[12] * dy


@njit(cache=True)
def _gain(r0: float, r1: float, S: tuple[float, float, float], look: Array, box: tuple[float, float], gate: float) -> tuple[float, bool]:
    """Log-likelihood ratio of "this person's box" over "clutter", −inf outside the gate; and whether the feet are taken as seen. box: `certain` and
    `lying` of it."""
    a, b, c = S
    det = a * c - b * b
    both = (c * r0 * r0 - 2 * b * r0 * r1 + a * r1 * r1) / det
    side = r0 * r0 / a
    certain, lying = box
    seen = certain + math.log(1 - lying) - 0.5 * (both + math.log(39.4784176 * det)) if both <= gate * gate else -np.inf
    # Feet out of sight: the lower edge is anywhere above where they must be, as far up as the body reaches.
    body = look[15]
    unseen = -np.inf
    if side <= gate * gate and -2 * math.sqrt(c) < r1 < body:
        unseen = certain + math.log(lying / body) - 0.5 * (side + math.log(6.28318531 * a))
    return max(seen, unseen), seen >= unseen


@njit(cache=True)
def _update(x: Array, P: Array, look: Array, r: tuple[float, float], S: tuple[float, float, float], m: int) -> None:
    """Kalman's update, in place: of a look and what is seen in it the first m rows, residual r, its covariance S as its entries 00, 01, 11."""
    a, b, c, d = look[9], look[10], look[11], look[12]
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


@njit(cache=True)
def log_likelihood(look: Array, S0: tuple[float, float, float], v: int, d: int, boxes: Any, gate: float) -> float:
    """Log-likelihood ratio of box d of view v for whom a look with such an `expected` covariance finds; −inf outside the gate."""
    r0, r1 = _residual(look, v, d, boxes)
    C = boxes.covariance[d]
    return _gain(r0, r1, (S0[0] + C[0, 0], S0[1] + C[0, 1], S0[2] + C[1, 1]), look, (boxes.certain[d], boxes.lying[d]), gate)[0]


@njit(cache=True)
def gate(v: int, i: int, leaves: Any, boxes: Any, n: Any, near: Ints) -> int:
    """Rows of the boxes of view v that leaf i may take, by its prediction alone, into `near`; how many."""
    look = np.empty(16)
    predict_measurement(leaves.state[i], leaves.z[i], leaves.slope[i], boxes.origin[v], look)
    S0 = innovation_covariance(look, leaves.covariance[i], n.foot_spread)
    found, worth = 0, np.empty(NEAREST)
    for d in range(boxes.start[v], boxes.start[v + 1]):
        if not boxes.usable[d]:
            continue
        direction = boxes.direction[d]
        if look[0] * direction[0] + look[1] * direction[1] + look[2] * direction[2] < 0.5:
            continue
        height = boxes.origin[v, 2] - leaves.z[i] + look[14] * boxes.head[d]
        slack = 0.15 + 0.02 * look[13]
        if not n.low - slack < height < n.high + slack:
            continue
        ratio = log_likelihood(look, S0, v, d, boxes, n.gate) + leaves.alike[i, d]
        if ratio == -np.inf:
            continue
        if found < NEAREST:
            near[found], worth[found] = d, ratio
            found += 1
        else:
            k = np.argmin(worth)
            if ratio > worth[k]:
                near[k], worth[k] = d, ratio
    return found


@njit(cache=True)
def order(i: int, leaves: Any, boxes: Any) -> Ints:
    """Views from the one whose sight lines place leaf i best: distance² over height, which is what an angle becomes on the ground."""
    V = len(boxes.origin)
    key = np.empty(V)
    for v in range(V):
        dx, dy = leaves.state[i, 0] - boxes.origin[v, 0], leaves.state[i, 1] - boxes.origin[v, 1]
        key[v] = (dx * dx + dy * dy) / max(boxes.origin[v, 2] - leaves.z[i], 0.1)
    return np.argsort(key, kind="mergesort")


@njit(cache=True)
def update_child(k: int, i: int, v: int, d: int, leaves: Any, boxes: Any, n: Any, ways: Any) -> float:
    """Way k of leaf i takes box d of view v, in place; its log-likelihood ratio."""
    look = np.empty(16)
    predict_measurement(ways.state[k], leaves.z[i], leaves.slope[i], boxes.origin[v], look)
    S0 = innovation_covariance(look, ways.covariance[k], n.foot_spread)
    r0, r1 = _residual(look, v, d, boxes)
    C = boxes.covariance[d]
    S = (S0[0] + C[0, 0], S0[1] + C[0, 1], S0[2] + C[1, 1])
    worth, upright = _gain(r0, r1, S, look, (boxes.certain[d], boxes.lying[d]), n.gate)
    _update(ways.state[k], ways.covariance[k], look, (r0, r1), S, 2 if upright else 1)
    ways.box[k, v] = d
    if upright:
        ways.residual[k, v, 0], ways.residual[k, v, 1] = r0, r1
        ways.H[k, v, 0, 0], ways.H[k, v, 0, 1], ways.H[k, v, 1, 0], ways.H[k, v, 1, 1] = look[9], look[10], look[11], look[12]
        ways.S[k, v, 0, 0], ways.S[k, v, 1, 1] = S[0], S[2]
        ways.S[k, v, 0, 1] = ways.S[k, v, 1, 0] = S[1]
    return worth + leaves.alike[i, d]


@njit(cache=True)
def blank(m: int, V: int) -> Any:
    """The columns of m Branches before V views that have taken nothing yet."""
    return (
        np.zeros(m, np.int64), np.full((m, V), -1, np.int64), np.zeros(m), np.zeros(m), np.zeros((m, 4)), np.zeros((m, 4, 4)),
        np.full((m, V, 2), np.nan), np.zeros((m, V, 2, 2)), np.zeros((m, V, 2, 2)),
    )  # fmt: skip


NARROW = 2
"""Ways that are followed from view to view where only the best without some box is wanted."""


@njit(cache=True)
def _ways(i: int, leaves: Any, boxes: Any, n: Any, near: Ints, banned: Mask, beam: Any) -> int:
    """All ways of leaf i to go on into the arrays of `beam` (a Branches; as many are followed as it has rows), unordered; how many.

    near (V, NEAREST): boxes that it may take, −1 after the last; banned (D,): those that it must not.
    """
    B = len(beam.gain)
    look = np.empty(16)
    beam.state[0], beam.covariance[0], beam.gain[0], count = leaves.state[i], leaves.covariance[i], 0.0, 1
    beam.box[:], beam.residual[:], beam.missed[:] = -1, np.nan, 0.0
    size = B * (NEAREST + 1)
    worth, source, taken = np.empty(size), np.empty(size, np.int64), np.empty(size, np.int64)
    for v in order(i, leaves, boxes):
        missed = leaves.missed[i, v]
        if near[v, 0] < 0:
            beam.gain[:count] += missed
            beam.missed[:count] += missed
            continue
        offers = 0
        for b in range(count):
            worth[offers], source[offers], taken[offers] = beam.gain[b] + missed, b, -1
            offers += 1
            predict_measurement(beam.state[b], leaves.z[i], leaves.slope[i], boxes.origin[v], look)
            S0 = innovation_covariance(look, beam.covariance[b], n.foot_spread)
            for d in near[v]:
                if d < 0:
                    break
                if banned[d]:
                    continue
                more = log_likelihood(look, S0, v, d, boxes, n.gate) + leaves.alike[i, d]
                if more > max(missed - n.width, n.least):
                    worth[offers], source[offers], taken[offers] = beam.gain[b] + more, b, d
                    offers += 1
        chosen = np.argsort(-worth[:offers], kind="mergesort")[:B]
        state, covariance, box = beam.state.copy(), beam.covariance.copy(), beam.box.copy()
        residuals, Hs, Ss, absent = beam.residual.copy(), beam.H.copy(), beam.S.copy(), beam.missed.copy()
        for q in range(len(chosen)):
            b, d = source[chosen[q]], taken[chosen[q]]
            beam.state[q], beam.covariance[q], beam.box[q], beam.gain[q] = state[b], covariance[b], box[b], worth[chosen[q]]
            beam.residual[q], beam.H[q], beam.S[q] = residuals[b], Hs[b], Ss[b]
            beam.missed[q] = absent[b]
            if d < 0:
                beam.missed[q] += missed
                continue
            update_child(q, i, v, d, leaves, boxes, n, beam)
        count = len(chosen)
    return count


@njit(cache=True)
def _wanted(leaves: Any, boxes: Any, n: Any) -> tuple[Any, Mask]:
    """Boxes (n, V, NEAREST) that each leaf may take, −1 after the last, and which boxes (D,) leaves of several trees may take."""
    V, D = len(boxes.origin), len(boxes.usable)
    near, owner = np.full((len(leaves.state), V, NEAREST), -1), np.full(D, -1)
    for i in range(len(leaves.state)):
        if leaves.over[i]:
            continue
        for v in range(V):
            for k in range(gate(v, i, leaves, boxes, n, near[i, v])):
                d, t = near[i, v, k], leaves.tree[i]
                owner[d] = t if owner[d] == -1 or owner[d] == t else -2
    return near, owner == -2


@njit(cache=True)
def _write(out: Any, m: int, start: int, i: int, beam: Any, b: int) -> int:
    """Way b of leaf i into row m, unless it is among rows start to m or takes no box; the next free row."""
    if not (beam.box[b] >= 0).any():
        return m
    for k in range(start, m):
        if (out.box[k] == beam.box[b]).all():
            return m
    out.parent[m], out.box[m], out.gain[m], out.missed[m] = i, beam.box[b], beam.gain[b], beam.missed[b]
    out.state[m], out.covariance[m], out.residual[m] = beam.state[b], beam.covariance[b], beam.residual[b]
    out.H[m], out.S[m] = beam.H[b], beam.S[b]
    return m + 1


@njit(cache=True)
def _spared(box: Ints, banned: Mask) -> bool:
    """Whether one of the ways (k, V) takes none of the boxes that are banned."""
    for k in range(len(box)):
        free = True
        for v in range(box.shape[1]):
            free = free and (box[k, v] < 0 or not banned[box[k, v]])
        if free:
            return True
    return False


@njit(cache=True)
def branch(leaves: ParentHypotheses, boxes: BoxTable, n: BranchingConstants) -> ChildHypotheses:
    """All ways in which the leaves may go on at this tick; each has one without any box.

    Of the best way, each box that another tree may take, too, is forbidden in turn, and then all of them, where no way does without already:
    whatever others take, a way is left.
    """
    V = len(boxes.origin)
    out = ChildHypotheses(*blank(len(leaves.state) * (n.most + V + 2), V))
    beam, narrow = ChildHypotheses(*blank(n.beam, V)), ChildHypotheses(*blank(min(n.beam, NARROW), V))
    near, contested = _wanted(leaves, boxes, n)
    banned = np.zeros(len(boxes.usable), np.bool_)
    m = 0
    for i in range(len(leaves.state)):
        if not leaves.over[i]:
            count, start = _ways(i, leaves, boxes, n, near[i], banned, beam), m
            ranked = np.argsort(-beam.gain[:count], kind="mergesort")
            least = beam.gain[ranked[0]] - n.width
            for b in ranked:
                if m - start < n.most and beam.gain[b] >= least:
                    m = _write(out, m, start, i, beam, b)
            taken = out.box[start].copy() if m > start else np.full(V, -1)
            for v in range(V + 1):
                for w in range(V):
                    if (w == v or v == V) and taken[w] >= 0 and contested[taken[w]]:
                        banned[taken[w]] = True
                if banned.any() and not _spared(out.box[start:m], banned):
                    count = _ways(i, leaves, boxes, n, near[i], banned, narrow)
                    b = int(np.argmax(narrow.gain[:count]))
                    if narrow.gain[b] >= least:
                        m = _write(out, m, start, i, narrow, b)
                banned[:] = False
        out.parent[m], out.state[m], out.covariance[m] = i, leaves.state[i], leaves.covariance[i]
        # Where all views lose a person at once they do so for one reason.
        out.gain[m] = 0.0 if leaves.over[i] else max(leaves.missed[i].sum(), n.floor)
        out.missed[m] = out.gain[m]
        m += 1
    return ChildHypotheses(
        out.parent[:m].copy(), out.box[:m].copy(), out.gain[:m].copy(), out.missed[:m].copy(), out.state[:m].copy(), out.covariance[:m].copy(),
        out.residual[:m].copy(), out.H[:m].copy(), out.S[:m].copy(),
    )  # fmt: skip


SURE = 50.0
"""Log-likelihood by which nothing is worse that is looked at."""


def assign_jointly(rows: Ints, leaves: ParentHypotheses, boxes: BoxTable, n: BranchingConstants) -> tuple[ChildHypotheses, Array]:
    """One way for each of `rows`, leaves that are true together: view after view the boxes are shared out among them for the highest sum. Ways that
    are found leaf by leaf seldom go together where people stand close before many views. And what each of them (k, D) would gain by each box over
    none, 0 where nothing."""
    k, V = len(rows), len(boxes.origin)
    out, worth = ChildHypotheses(*blank(k, V)), np.zeros((k, len(boxes.usable)))
    out.parent[:] = rows
    out.state[:], out.covariance[:] = leaves.state[rows], leaves.covariance[rows]
    for v in _from_best(rows, leaves, boxes):
        more = np.maximum(_gains(v, rows, leaves, boxes, n, out) - leaves.missed[rows, v, None], 0.0)
        worth[:, boxes.start[v] : boxes.start[v + 1]] = more
        i, d = _shared_out(more)
        box = np.full(k, -1)
        box[i] = d + boxes.start[v]
        _take(v, box, leaves, boxes, n, out)
    return out, worth


def assigned_boxes(rows: Ints, ways: ChildHypotheses, boxes: BoxTable) -> Mask:
    """Which boxes (D,) somebody takes where the leaves in `rows` go on in any of their ways, boxes shared out for the highest sum, view by view."""
    place = np.full(max(ways.parent.max(initial=-1), rows.max(initial=-1)) + 1, -1)
    place[rows] = np.arange(len(rows))
    mine = place[ways.parent] >= 0
    row, box, gain = place[ways.parent[mine]], ways.box[mine], ways.gain[mine]
    out = np.zeros(len(boxes.usable), dtype=bool)
    for v, (start, end) in enumerate(itertools.pairwise(boxes.start.tolist())):
        worth = np.full((len(rows), end - start + 1), -np.inf)
        np.maximum.at(worth, (row, np.where(box[:, v] >= 0, box[:, v] - start, -1)), gain)
        # Where no way is left without a box of this view, one of them is surely theirs.
        none = np.maximum(worth[:, -1:], worth.max(axis=1, keepdims=True) - SURE)
        out[start + _shared_out(np.maximum(worth[:, :-1] - none, 0.0))[1]] = True
    return out


def _shared_out(more: Array) -> tuple[Ints, Ints]:
    """Rows and boxes (m,) that go together for the highest sum of what each row gains by each box over none (k, d), 0 where nothing."""
    rows, boxes = linear_sum_assignment(more, maximize=True)
    taken = more[rows, boxes] > 0
    return rows[taken], boxes[taken]


@njit(cache=True)
def _from_best(rows: Ints, leaves: Any, boxes: Any) -> Ints:
    """Views from the one whose sight lines place most of `rows` best."""
    rank = np.zeros(len(boxes.origin))
    for i in rows:
        rank[order(i, leaves, boxes)] += np.arange(len(rank))
    return np.argsort(rank, kind="mergesort")


@njit(cache=True)
def _gains(v: int, rows: Ints, leaves: Any, boxes: Any, n: Any, ways: Any) -> Array:
    """Log-likelihood ratio (k, d) of each box of view v for each of `rows`, as far as they have gone in `ways`; −inf where it is not taken."""
    first, end = boxes.start[v], boxes.start[v + 1]
    out, look, near = np.full((len(rows), end - first), -np.inf), np.empty(16), np.empty(NEAREST, np.int64)
    for k, i in enumerate(rows):
        found = gate(v, i, leaves, boxes, n, near)
        predict_measurement(ways.state[k], leaves.z[i], leaves.slope[i], boxes.origin[v], look)
        S0 = innovation_covariance(look, ways.covariance[k], n.foot_spread)
        for d in near[:found]:
            worth = log_likelihood(look, S0, v, d, boxes, n.gate) + leaves.alike[i, d]
            if worth > 0.0:
                out[k, d - first] = worth
    return out


@njit(cache=True)
def _take(v: int, box: Ints, leaves: Any, boxes: Any, n: Any, ways: Any) -> None:
    """Go on in `ways`, in place, by the box (k,) that each takes of view v, −1 for none."""
    for k in range(len(box)):
        i, d = ways.parent[k], box[k]
        if d < 0:
            ways.gain[k] += leaves.missed[i, v]
            ways.missed[k] += leaves.missed[i, v]
            continue
        ways.gain[k] += update_child(k, i, v, d, leaves, boxes, n, ways)


def union(ways: ChildHypotheses, more: ChildHypotheses) -> ChildHypotheses:
    """`ways` and those of `more` that take a box and are not among them, in the order of Branches."""
    known = {(p, *b) for p, b in zip(ways.parent.tolist(), ways.box.tolist(), strict=True)}
    found = [(p, *b) not in known and max(b, default=-1) >= 0 for p, b in zip(more.parent.tolist(), more.box.tolist(), strict=True)]
    fresh = np.flatnonzero(found)
    if not len(fresh):
        return ways
    both = ChildHypotheses._make(np.concatenate([a, b[fresh]]) for a, b in zip(ways, more, strict=True))
    rows = np.lexsort((-both.gain, (both.box < 0).all(axis=1), both.parent))
    return ChildHypotheses._make(column[rows] for column in both)
