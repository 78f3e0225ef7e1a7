"""EKF-SLAM of a team in the plane: SE(2) robots, point landmarks, one joint covariance, and measurements of range and bearing.

A robot has eight numbers: x, y (m), heading (rad), its correction factor and two scale errors of its odometry (of speed and of turn, as
shares). The correction factor is an offset β of all its bearings (rad), one ρ of all its ranges (m), and the scale error κ of its ranges. A
landmark has two numbers. An error is true minus estimated, added to each number. Numbers without variance are not estimated.
range = (1 + κ) ‖q − p‖ + ρ, bearing = angle(q − p) − heading + β.

The modes:

* EKF: the plain filter. With more than one linearisation it is the iterated filter.
* FEJ: first-estimates Jacobians, at a landmark's initial and a robot's last predicted position (Huang, Mourikis, Roumeliotis 2010).
* INVARIANT: the right-invariant error of each robot, landmarks tied to the observing robot (Barrau & Bonnabel 2015; Zhang et al. 2017). In
  the plain error prediction is the same. After an update that moved a position by Δ its error gains JΔ times the heading's error
  (`transport_covariance`). A rotation of the whole world then stays unobservable for all estimates.
* BOUND: Jacobians at the truth, which the mean follows: the recursion of the posterior Cramér-Rao bound (Tichavský et al. 1998).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tracker.geometry import Array
from tracker.geometry.compilation import njit

EKF, FEJ, INVARIANT, BOUND = 0, 1, 2, 3
MODES = {"ekf": EKF, "iekf": EKF, "fej": FEJ, "invariant": INVARIANT}
"""By name; the EKF always has one linearisation."""
ROBOT = 8
"""Numbers of a robot: x, y, heading, bearing offset β, range offset ρ, range scale κ, speed scale, turn scale."""
MATCHED, OUTLIER, INFLATED, STARTED, EVENT = range(5)
"""Indices of PlanarState.counts: inliers, outliers, covariance inflations, initialized landmarks, and the number of the present event."""


STEP, SCAN, OUTPUT = 0, 1, 2
"""Kinds of events: a robot moves, a robot measures, the team's poses are output."""


class PlanarState(NamedTuple):
    """The state of the filter.

    mean (n,), P (n, n), first (n,): first estimates. initialized (landmarks,). outlier_excess (robots,): recent outliers in excess of inliers.
    counts: by the indices above.
    """

    mean: Array
    P: Array
    first: Array
    initialized: NDArray[np.bool_]
    outlier_excess: NDArray[np.int64]
    counts: NDArray[np.int64]


class FilterSettings(NamedTuple):
    """Parameters of the compiled functions; truth (landmarks, 2) m: initial positions in the mode BOUND. The others are as in PlanarParameters."""

    mode: int
    iterations: int
    robust: float
    curvature: float
    max_outlier_excess: int
    inflation_sigma: tuple[float, float]
    truth: Array


class EventSchedule(NamedTuple):
    """Events in the order of time: kind, robot, item (e,) and time (e,) s.

    Steps have motion (m, 2) m, rad and noise (m, 8) as in `predict`. Scan k has the rows start[k] to start[k + 1] of subject (z,), z (z, 2)
    m, rad, and sigma (z, 2). outputs: the number of output times.
    """

    kind: NDArray[np.int64]
    robot: NDArray[np.int64]
    item: NDArray[np.int64]
    motion: Array
    noise: Array
    start: NDArray[np.int64]
    subject: NDArray[np.int64]
    z: Array
    sigma: Array
    time: Array
    outputs: int


class Scan(NamedTuple):
    """Simultaneous measurements of one robot: subject (k,), z (k, 2) m, rad, and sigma (k, 2).

    A subject is a robot's number, or the number of robots plus a landmark's.
    """

    subject: NDArray[np.int64]
    z: Array
    sigma: Array


@njit(cache=True)
def linearize(s: Any, indices: Any, z: Any, H: Any) -> Any:
    """Fill the Jacobian H (2, n), and return the residual z − h (2,) m, rad.

    indices: whether to use first estimates, and the first columns of robot and subject.
    """
    fej, at, to = indices
    x = s.mean
    dx, dy = x[to] - x[at], x[to + 1] - x[at + 1]
    turn = z[1] - np.arctan2(dy, dx) + x[at + 2] - x[at + 3]
    residual = np.array([z[0] - (1 + x[at + 5]) * np.hypot(dx, dy) - x[at + 4], (turn + np.pi) % (2 * np.pi) - np.pi])
    if fej:
        dx, dy = s.first[to] - s.first[at], s.first[to + 1] - s.first[at + 1]
    r2 = max(dx * dx + dy * dy, 1e-6)
    r = np.sqrt(r2)
    ex, ey = (1 + x[at + 5]) * dx / r, (1 + x[at + 5]) * dy / r
    H[0, at], H[0, at + 1], H[0, to], H[0, to + 1], H[0, at + 4], H[0, at + 5] = -ex, -ey, ex, ey, 1.0, r
    H[1, at], H[1, at + 1], H[1, to], H[1, to + 1], H[1, at + 2], H[1, at + 3] = dy / r2, -dx / r2, -dy / r2, dx / r2, -1.0, 1.0
    return residual


@njit(cache=True)
def invert_measurement(s: Any, indices: Any, z: Any, sigma: Any) -> Any:
    """Set the landmark's mean by the inverse model; a negative column −to leaves it unchanged.

    Returns its Jacobian G (2, 6) in the robot's x, y, heading, β, ρ, κ, and the measurement's part of its covariance (2, 2) m².
    """
    fej, at, to = indices
    x = s.mean
    if to >= 0:
        direction, r = x[at + 2] + z[1] - x[at + 3], (z[0] - x[at + 4]) / (1 + x[at + 5])
        x[to], x[to + 1] = x[at] + r * np.cos(direction), x[at + 1] + r * np.sin(direction)
    to = abs(to)
    p = s.first if fej else x
    dx, dy = x[to] - p[at], x[to + 1] - p[at + 1]
    r = max(np.hypot(dx, dy), 1e-3)
    ex, ey, k = dx / r, dy / r, 1 / (1 + x[at + 5])
    G = np.array([[1.0, 0.0, -dy, dy, -k * ex, -k * dx], [0.0, 1.0, dx, -dx, -k * ey, -k * dy]])
    across = np.array([-dy, dx]) * sigma[1]
    along = np.array([ex, ey]) * sigma[0] * k
    return G, np.outer(across, across) + np.outer(along, along)


@njit(cache=True)
def column(robots: int, subject: int) -> int:
    """The first column of a subject in the state."""
    return ROBOT * min(subject, robots) + 2 * max(subject - robots, 0)


@njit(cache=True)
def predict(s: Any, fej: bool, at: int, motion: Any, noise: Any) -> None:
    """Move the robot with the columns from `at` by motion = (distance m, turn rad) along an arc.

    noise: variances of distance, lateral error and turn (m², m², rad²), then increments for the last five numbers (rad², m², shares²).
    """
    P, mean = s.P, s.mean
    x, y, h, speed, turn = at, at + 1, at + 2, at + 6, at + 7
    bend = 0.5 * (1 + mean[turn]) * motion[1]
    chord = motion[0] * (np.sin(bend) / bend if abs(bend) > 1e-9 else 1.0)
    c, n = np.cos(mean[h] + bend), np.sin(mean[h] + bend)
    dx, dy = (1 + mean[speed]) * chord * c, (1 + mean[speed]) * chord * n
    from_x, from_y = (s.first[x], s.first[y]) if fej else (mean[x], mean[y])
    mean[x], mean[y], mean[h] = mean[x] + dx, mean[y] + dy, mean[h] + 2 * bend
    s.first[x], s.first[y] = mean[x], mean[y]
    ax, ay, half = -(mean[y] - from_y), mean[x] - from_x, 0.5 * motion[1]
    for j in range(len(mean)):
        P[x, j] += ax * P[h, j] + chord * c * P[speed, j] - half * dy * P[turn, j]
        P[y, j] += ay * P[h, j] + chord * n * P[speed, j] + half * dx * P[turn, j]
        P[h, j] += motion[1] * P[turn, j]
    for j in range(len(mean)):
        P[j, x] += ax * P[j, h] + chord * c * P[j, speed] - half * dy * P[j, turn]
        P[j, y] += ay * P[j, h] + chord * n * P[j, speed] + half * dx * P[j, turn]
        P[j, h] += motion[1] * P[j, turn]
    G = np.array([[c, -n, -0.5 * dy], [n, c, 0.5 * dx], [0.0, 0.0, 1.0]])
    for i in range(3):
        for j in range(3):
            P[at + i, at + j] += G[i, 0] * G[j, 0] * noise[0] + G[i, 1] * G[j, 1] * noise[1] + G[i, 2] * G[j, 2] * noise[2]
    for i in range(5):
        P[at + 3 + i, at + 3 + i] += noise[3 + i]


@njit(cache=True)
def update(s: Any, settings: Any, robot: int, scan: Any) -> Any:
    """Update by measurements of initialized subjects with a fixed number of linearisations; returns their weights (k,). P in Joseph's form.

    rᵢ = z − h(xᵢ) + Hᵢ δᵢ with xᵢ = x⁻ ⊞ δᵢ and Hᵢ the derivative by δ (Bell & Cathey 1993).
    """
    k, robots = len(scan.z), len(s.outlier_excess)
    prior, delta, weight = s.mean.copy(), np.zeros(len(s.mean)), np.ones(k)
    sigma = scan.sigma.ravel() if settings.curvature == 0 else inflated_sigma(s, settings, ROBOT * robot, scan).ravel()
    HP, K, S = np.zeros((2 * k, len(delta))), np.zeros((len(delta), 2 * k)), np.zeros((2 * k, 2 * k))
    for _ in range(settings.iterations):
        H, residual = np.zeros((2 * k, len(delta))), np.zeros(2 * k)
        for i in range(k):
            to = column(robots, scan.subject[i])
            residual[2 * i : 2 * i + 2] = linearize(s, (settings.mode == FEJ, ROBOT * robot, to), scan.z[i], H[2 * i : 2 * i + 2])
            if settings.mode == INVARIANT:
                _couple_rotation(H[2 * i : 2 * i + 2], ROBOT * robot, ROBOT * robot + 2, s.mean - prior)
                _couple_rotation(H[2 * i : 2 * i + 2], to, (to if to < ROBOT * robots else ROBOT * robot) + 2, s.mean - prior)
        HP = H @ s.P
        HPH = HP @ H.T
        innovation = residual + H @ delta
        weight = reweigh(HPH, sigma, innovation, settings.robust)
        S = HPH + np.diag(sigma**2 / np.repeat(weight, 2))
        K = np.ascontiguousarray(np.linalg.solve(S, HP).T)
        delta = K @ innovation
        if settings.mode != BOUND:
            retract(s, settings.mode == INVARIANT, robot, (prior, delta))
    U = HP.T - 0.5 * (K @ S)
    gain = K @ np.ascontiguousarray(U.T)
    s.P[:] = s.P - gain - gain.T
    if settings.mode == INVARIANT:
        transport_covariance(s, robot, s.mean - prior)
    return weight


@njit(cache=True)
def inflated_sigma(s: Any, settings: Any, at: int, scan: Any) -> Any:
    """Standard deviations (k, 2) of measurements, inflated by the share `curvature` of the second-order terms of range and bearing.

    Let v m² be the variance of the subject's position relative to the robot. The second derivatives 1/r and 1/r² then add about v/(√2 r) m
    and v/(√2 r²) rad. With first estimates their distance from the means adds to v.
    """
    sigma, P = scan.sigma.copy(), s.P
    for i in range(len(sigma)):
        to = column(len(s.outlier_excess), scan.subject[i])
        v = 0.0
        for axis in range(2):
            a, b = at + axis, to + axis
            v += P[a, a] + P[b, b] - 2 * P[a, b]
        r = np.hypot(s.mean[to] - s.mean[at], s.mean[to + 1] - s.mean[at + 1])
        if settings.mode == FEJ:
            dx, dy = s.first[to] - s.first[at], s.first[to + 1] - s.first[at + 1]
            v += (dx - s.mean[to] + s.mean[at]) ** 2 + (dy - s.mean[to + 1] + s.mean[at + 1]) ** 2
            r = min(r, np.hypot(dx, dy))
        r = max(r, 0.05)
        bend = settings.curvature * max(v, 0.0) / (np.sqrt(2.0) * r)
        sigma[i, 0], sigma[i, 1] = np.hypot(sigma[i, 0], bend), np.hypot(sigma[i, 1], bend / r)
    return sigma


@njit(cache=True)
def _couple_rotation(H: Any, at: int, heading: int, moved: Any) -> None:
    """Add to H how an error of the heading displaces the position at `at`, which has moved by `moved`."""
    for row in range(2):
        H[row, heading] += H[row, at + 1] * moved[at] - H[row, at] * moved[at + 1]


@njit(cache=True)
def retract(s: Any, invariant: bool, robot: int, change: Any) -> None:
    """mean ← prior ⊞ δ, change = (prior, δ).

    It is a sum, except that the invariant error moves positions by V(δθ) δp. This equals the exponential of SE(2) applied to
    R(δθ) p + V(δθ)(δp − δθ J p). Landmarks use the heading of `robot`.
    """
    prior, delta = change
    s.mean[:] = prior + delta
    if not invariant:
        return
    team = ROBOT * len(s.outlier_excess)
    for at in list(range(0, team, ROBOT)) + list(range(team, len(prior), 2)):
        angle = delta[(at if at < team else ROBOT * robot) + 2]
        sine, cosine = 1 - angle**2 / 6, angle / 2
        if abs(angle) > 1e-4:
            sine, cosine = np.sin(angle) / angle, (1 - np.cos(angle)) / angle
        s.mean[at] = prior[at] + sine * delta[at] - cosine * delta[at + 1]
        s.mean[at + 1] = prior[at + 1] + cosine * delta[at] + sine * delta[at + 1]


@njit(cache=True)
def transport_covariance(s: Any, robot: int, moved: Any) -> None:
    """P ← M P Mᵀ after the mean has moved by `moved` (n,): each position's error gains J moved times its heading's error."""
    team, P = ROBOT * len(s.outlier_excess), s.P
    places = list(range(0, team, ROBOT)) + list(range(team, len(moved), 2))
    for at in places:
        heading = (at if at < team else ROBOT * robot) + 2
        P[at] -= moved[at + 1] * P[heading]
        P[at + 1] += moved[at] * P[heading]
    for at in places:
        heading = (at if at < team else ROBOT * robot) + 2
        P[:, at] -= moved[at + 1] * P[:, heading]
        P[:, at + 1] += moved[at] * P[:, heading]
    P[:] = 0.5 * (P + P.T)


@njit(cache=True)
def reweigh(HPH: Any, sigma: Any, innovation: Any, threshold: float) -> Any:
    """gaussian.robust_weights for pairs with independent noise sigma (2k,): the weights (k,)."""
    k = len(sigma) // 2
    weight = np.ones(k)
    if not np.isfinite(threshold):
        return weight
    for _ in range(4):
        noise = sigma**2 / np.repeat(weight, 2)
        force = np.linalg.solve(HPH + np.diag(noise), innovation)
        size = (sigma * force).reshape(k, 2) / weight.reshape(k, 1)
        square = np.maximum((size**2).sum(axis=1), 1e-24)
        weight = np.maximum(np.minimum(1.0, threshold**2 / square), 1e-6)
    return weight


@njit(cache=True)
def start_landmark(s: Any, settings: Any, robot: int, scan: Any, i: int) -> None:
    """Add the landmark of measurement i to the state by the inverse model."""
    robots = len(s.outlier_excess)
    to, at = column(robots, scan.subject[i]), ROBOT * robot
    G, own = invert_measurement(s, (settings.mode == FEJ, at, to), scan.z[i], scan.sigma[i])
    if settings.mode == BOUND:
        s.mean[to : to + 2] = settings.truth[scan.subject[i] - robots]
        G, own = invert_measurement(s, (settings.mode == FEJ, at, -to), scan.z[i], scan.sigma[i])
    s.first[to : to + 2] = s.mean[to : to + 2]
    cross = G @ s.P[at : at + 6]
    s.P[to : to + 2], s.P[:, to : to + 2] = cross, cross.T
    s.P[to : to + 2, to : to + 2] = np.ascontiguousarray(cross[:, at : at + 6]) @ np.ascontiguousarray(G.T) + own
    s.initialized[scan.subject[i] - robots] = True
    s.counts[STARTED] += 1


@njit(cache=True)
def process_scan(s: Any, settings: Any, robot: int, scan: Any) -> None:
    """Process a scan: update by initialized subjects, inflate the pose covariance after too many outliers, then initialize new landmarks."""
    robots, at = len(s.outlier_excess), ROBOT * robot
    new = np.array([subject >= robots and not s.initialized[subject - robots] for subject in scan.subject])
    old = Scan(scan.subject[~new], scan.z[~new], scan.sigma[~new])
    if len(old.z):
        for weight in update(s, settings, robot, old):
            bad = weight < 0.1
            s.outlier_excess[robot] = max(s.outlier_excess[robot] + (1 if bad else -1), 0)
            s.counts[OUTLIER if bad else MATCHED] += 1
    if s.outlier_excess[robot] >= settings.max_outlier_excess:
        s.outlier_excess[robot] = 0
        s.counts[INFLATED] += 1
        for i in range(3):
            s.P[at + i, at + i] += settings.inflation_sigma[0] ** 2 if i < 2 else settings.inflation_sigma[1] ** 2
    for i in range(len(scan.z)):
        if new[i] and not s.initialized[scan.subject[i] - robots]:
            start_landmark(s, settings, robot, scan, i)


@njit(cache=True)
def run_events(s: Any, settings: Any, schedule: Any, out: Any) -> bool:
    """Process all events; False if the state is not finite. out: poses (outputs, robots, 3) and covariances (outputs, robots, 3, 3) to fill."""
    path, spread = out
    output = 0
    for e in range(len(schedule.kind)):
        robot, item = schedule.robot[e], schedule.item[e]
        s.counts[EVENT] = e
        at = ROBOT * robot
        if schedule.kind[e] == STEP:
            predict(s, settings.mode == 1, at, schedule.motion[item], schedule.noise[item])
        elif schedule.kind[e] == SCAN:
            rows = slice(schedule.start[item], schedule.start[item + 1])
            process_scan(s, settings, robot, Scan(schedule.subject[rows], schedule.z[rows], schedule.sigma[rows]))
            if not (np.isfinite(s.mean).all() and np.isfinite(s.P[at, at])):
                return False
        else:
            for i in range(len(s.outlier_excess)):
                path[output, i] = s.mean[ROBOT * i : ROBOT * i + 3]
                spread[output, i] = s.P[ROBOT * i : ROBOT * i + 3, ROBOT * i : ROBOT * i + 3]
            output += 1
    return True
