"""What a leaf of a track tree sees of the boxes of a tick, compiled: expected direction, innovation, likelihood, and Kalman's update by a box."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from tracker.evidence import Evidence
from tracker.fusion import Feet
from tracker.geometry import Array
from tracker.ground import Ground
from tracker.leaves import Leaves

Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]

NEAREST = 12
"""Boxes of a view that a leaf looks at, at most."""


class Standing(NamedTuple):
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
    def of(leaves: Leaves, ground: Ground, missed: Array, alike: Array) -> Standing:
        """Leaves that have been predicted, on the ground."""
        place = leaves.state[:, :2]
        around = [np.array([0.1, 0.0]), np.array([0.0, 0.1])]
        slope = np.stack([(ground.height_at(place + e) - ground.height_at(place - e)) / 0.2 for e in around], axis=1)
        return Standing(leaves.state, leaves.covariance, ground.height_at(place), slope, missed, leaves.over, leaves.tree, alike)


class Boxes(NamedTuple):
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
    def of(views: list[Feet], evidence: Evidence, clutter: float) -> Boxes:
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
        return Boxes(
            origin, offset, evidence.offsets.centre, start, column("direction", (3,)), column("covariance", (2, 2)), column("lying", ()),
            np.tan(column("head_elevation", ())), certain, np.minimum(worth, q.most_gain), column("confidence", ()) >= q.min_confidence,
        )  # fmt: skip


class Numbers(NamedTuple):
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


class Branches(NamedTuple):
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
def look_at(x: Array, z: float, slope: Array, origin: Array, out: Array) -> None:
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
def expected(look: Array, P: Array, spread: float) -> tuple[float, float, float]:
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
def fit(look: Array, S0: tuple[float, float, float], v: int, d: int, boxes: Any, gate: float) -> float:
    """Log-likelihood ratio of box d of view v for whom a look with such an `expected` covariance finds; −inf outside the gate."""
    r0, r1 = _residual(look, v, d, boxes)
    C = boxes.covariance[d]
    return _gain(r0, r1, (S0[0] + C[0, 0], S0[1] + C[0, 1], S0[2] + C[1, 1]), look, (boxes.certain[d], boxes.lying[d]), gate)[0]


@njit(cache=True)
def reached(v: int, i: int, leaves: Any, boxes: Any, n: Any, near: Ints) -> int:
    """Rows of the boxes of view v that leaf i may take, by its prediction alone, into `near`; how many."""
    look = np.empty(16)
    look_at(leaves.state[i], leaves.z[i], leaves.slope[i], boxes.origin[v], look)
    S0 = expected(look, leaves.covariance[i], n.foot_spread)
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
        ratio = fit(look, S0, v, d, boxes, n.gate) + leaves.alike[i, d]
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
def accept(k: int, i: int, v: int, d: int, leaves: Any, boxes: Any, n: Any, ways: Any) -> float:
    """Way k of leaf i takes box d of view v, in place; its log-likelihood ratio."""
    look = np.empty(16)
    look_at(ways.state[k], leaves.z[i], leaves.slope[i], boxes.origin[v], look)
    S0 = expected(look, ways.covariance[k], n.foot_spread)
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
