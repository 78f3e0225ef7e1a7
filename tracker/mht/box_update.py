"""Likelihood of a box for a leaf, and the update of the leaf by it, compiled.

Where the feet are visible, their direction is Gaussian. Where the world is known, the upper edge measures the stature, too.
An ambiguous box (range_update.py) gives a density along its line of sight instead.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from tracker.geometry import Array
from tracker.geometry.compilation import njit
from tracker.mht.range_update import correct_range, head_log_ratio, range_log_density

MEASURED = (0, 1, 4)
"""Columns of a state that an upper edge measures: place and stature."""


PREDICTED = 22
"""Length of the output of `predict_measurement`."""


class HeadMeasurement(NamedTuple):
    """The upper edge of a box. above: innovation m, height less stature; H (3,): −∂above by place and stature; noise, spread: variances m²."""

    above: float
    H: Array
    noise: float
    spread: float


# Measurement prediction


@njit(cache=True)
def predict_measurement(x: Array, i: int, parents: Any, v: int, boxes: Any, out: Array) -> None:
    """Predicted direction from view v to the feet of a person at x, a partial child of leaf i, at the time of the view.

    out[0:3] direction; [3:6], [6:9] basis of its tangent plane; [9:13] H row by row. [13] distance m; [14] horizontal distance m;
    [15] rad that a body extends upwards; [16] height m of the ground; [17:19] its slope; [19:21] the place m.
    [21] s from the tick to the view.
    """
    slope, place, origin, later = parents.slope[i], parents.state[i], boxes.origin[v], boxes.later[v]
    px, py = x[0] + later * x[2], x[1] + later * x[3]
    z = parents.z[i] + slope[0] * (px - place[0]) + slope[1] * (py - place[1])
    sx, sy, sz = px - origin[0], py - origin[1], z - origin[2]
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
    out[16], out[17], out[18], out[19], out[20], out[21] = z, slope[0], slope[1], px, py, later


@njit(cache=True)
def innovation_covariance(predicted: Array, P: Array, spread: float) -> tuple[float, float, float]:
    """H (P + spread² I) Hᵀ as its entries 00, 01, 11; P of the place at the time of the view."""
    t = predicted[21]
    p = P[0, 0] + t * (2 * P[0, 2] + t * P[2, 2]) + spread * spread
    q = P[0, 1] + t * (P[0, 3] + P[1, 2] + t * P[2, 3])
    r = P[1, 1] + t * (2 * P[1, 3] + t * P[3, 3]) + spread * spread
    a, b, c, d = predicted[9], predicted[10], predicted[11], predicted[12]
    return a * a * p + 2 * a * b * q + b * b * r, a * c * p + (a * d + b * c) * q + b * d * r, c * c * p + 2 * c * d * q + d * d * r


# Log-likelihood and update


@njit(cache=True)
def log_likelihood(predicted: Array, x: Array, P: Array, v: int, d: int, boxes: Any, limits: Any) -> float:
    """Log-likelihood ratio of box d of view v over clutter for a leaf x (5,), P (5, 5); −inf outside the gate."""
    if boxes.ambiguous[d] >= 0:
        return boxes.detection_ratio[d] + range_log_density(x, P, v, d, boxes, limits)
    height = boxes.origin[v, 2] - predicted[16] + predicted[14] * boxes.head_slope[d]
    slack = 0.15 + 0.02 * predicted[13]
    if not limits.min_height - slack < height < limits.max_height + slack:
        return -np.inf
    r0, r1 = _residual(predicted, v, d, boxes)
    S = _innovation(predicted, P, d, boxes, limits)
    ratio = _log_ratio(r0, r1, S, predicted, (boxes.detection_ratio[d], boxes.feet_hidden[d]), limits.gate)[0]
    if boxes.stature[d] and ratio > -np.inf:
        head = head_of(predicted, x, P, v, d, boxes)
        ratio += head_log_ratio(head.above, head.spread, height, head.noise, boxes.ranges.people)
    return ratio


@njit(cache=True)
def _innovation(predicted: Array, P: Array, d: int, boxes: Any, limits: Any) -> tuple[float, float, float]:
    """Covariance of the innovation of box d, as its entries 00, 01, 11."""
    S0, C = innovation_covariance(predicted, P, limits.foot_spread), boxes.covariance[d]
    return S0[0] + C[0, 0], S0[1] + C[0, 1], S0[2] + C[1, 1]


@njit(cache=True)
def shift(predicted: Array, v: int, boxes: Any) -> tuple[float, float]:
    """The registration bias, m, of view v at the predicted place."""
    bias, x, y = boxes.bias[v], predicted[19] - boxes.centre[0], predicted[20] - boxes.centre[1]
    return bias[0] + bias[2] * x + bias[3] * y, bias[1] + bias[4] * x + bias[5] * y


@njit(cache=True)
def _residual(predicted: Array, v: int, d: int, boxes: Any) -> tuple[float, float]:
    """Innovation of box d of view v in the tangent plane of the predicted direction, without the view's registration bias."""
    direction = boxes.direction[d]
    dx, dy = shift(predicted, v, boxes)
    r0 = predicted[3] * direction[0] + predicted[4] * direction[1]
    r1 = predicted[6] * direction[0] + predicted[7] * direction[1] + predicted[8] * direction[2]
    return r0 - predicted[9] * dx - predicted[10] * dy, r1 - predicted[11] * dx - predicted[12] * dy


@njit(cache=True)
def _log_ratio(r0: float, r1: float, S: tuple[float, float, float], predicted: Array, box: tuple[float, float], gate: float) -> tuple[float, bool]:
    """Log-likelihood ratio of an innovation over clutter, −inf outside the gate; and whether the feet are taken as visible.

    box: its `detection_ratio` and `feet_hidden`.
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
def head_of(predicted: Array, x: Array, P: Array, v: int, d: int, boxes: Any) -> HeadMeasurement:
    """The upper edge of box d of view v as a measurement of x."""
    origin, slope, away = boxes.origin[v], boxes.head_slope[d], max(predicted[14], 1e-9)
    H = np.empty(3)
    H[0] = predicted[17] - (predicted[19] - origin[0]) / away * slope
    H[1] = predicted[18] - (predicted[20] - origin[1]) / away * slope
    H[2] = 1.0
    noise = boxes.covariance[d, 1, 1] * predicted[13] ** 2 + boxes.ranges.head_sigma**2
    spread = noise
    for i in range(3):
        for j in range(3):
            spread += H[i] * H[j] * P[MEASURED[i], MEASURED[j]]
    return HeadMeasurement(origin[2] - predicted[16] + predicted[14] * slope - x[4], H, noise, spread)


@njit(cache=True)
def update_child(k: int, i: int, v: int, d: int, parents: Any, boxes: Any, limits: Any, children: Any) -> None:
    """Update child k of leaf i by box d of view v, in place."""
    predicted, x, P = np.empty(PREDICTED), children.state[k], children.covariance[k]
    predict_measurement(x, i, parents, v, boxes, predicted)
    children.box[k, v] = d
    if boxes.ambiguous[d] >= 0:
        correct_range(x, P, v, d, boxes, limits)
        return
    r0, r1 = _residual(predicted, v, d, boxes)
    S = _innovation(predicted, P, d, boxes, limits)
    _, visible = _log_ratio(r0, r1, S, predicted, (boxes.detection_ratio[d], boxes.feet_hidden[d]), limits.gate)
    head, before = head_of(predicted, x, P, v, d, boxes), x.copy()
    _kalman_update(x, P, predicted, (r0, r1), S, 2 if visible else 1)
    if (boxes.stature[d] or (boxes.cut[d] and not visible)) and head.above**2 < limits.gate**2 * head.spread:
        update_by_head(x, P, head, before)
    if visible:
        H = children.H[k, v]
        children.residual[k, v, 0], children.residual[k, v, 1] = r0, r1
        H[0, 0], H[0, 1], H[1, 0], H[1, 1] = predicted[9], predicted[10], predicted[11], predicted[12]
        children.S[k, v, 0, 0], children.S[k, v, 1, 1] = S[0], S[2]
        children.S[k, v, 0, 1] = children.S[k, v, 1, 0] = S[1]


@njit(cache=True)
def _kalman_update(x: Array, P: Array, predicted: Array, r: tuple[float, float], S: tuple[float, float, float], m: int) -> None:
    """The Kalman update of x (5,), P (5, 5) in place, by the first m components of the innovation r with covariance S, entries 00, 01, 11."""
    a, b, c, d = predicted[9], predicted[10], predicted[11], predicted[12]
    old = P[:2] + predicted[21] * P[2:4]
    det = S[0] * S[2] - S[1] * S[1]
    for i in range(5):
        p0 = a * old[0, i] + b * old[1, i]
        p1 = c * old[0, i] + d * old[1, i]
        k0, k1 = p0 / S[0], 0.0
        if m == 2:
            k0, k1 = (p0 * S[2] - p1 * S[1]) / det, (p1 * S[0] - p0 * S[1]) / det
        x[i] += k0 * r[0] + k1 * r[1]
        for j in range(i, 5):
            P[i, j] -= k0 * (a * old[0, j] + b * old[1, j]) + k1 * (c * old[0, j] + d * old[1, j])
            P[j, i] = P[i, j]


@njit(cache=True)
def update_by_head(x: Array, P: Array, head: HeadMeasurement, before: Array) -> None:
    """The Kalman update of x, P in place by an upper edge, linearized at the state `before`."""
    r, H, p, S = head.above, head.H, np.zeros(5), head.noise
    for j in range(3):
        r -= H[j] * (x[MEASURED[j]] - before[MEASURED[j]])
        for i in range(5):
            p[i] += H[j] * P[i, MEASURED[j]]
    for j in range(3):
        S += H[j] * p[MEASURED[j]]
    for i in range(5):
        x[i] += p[i] / S * r
        for j in range(i, 5):
            P[i, j] -= p[i] * p[j] / S
            P[j, i] = P[i, j]
