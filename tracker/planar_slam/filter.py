"""EKF-SLAM of a team in the plane: SE(2) robots, landmarks in metres, one joint covariance, range and bearing.

A robot has eight numbers: x, y (m), heading (rad), its correction factor (offsets of all its bearings, rad, and ranges, m, and the scale error
of its ranges) and its odometry's scale errors (of speed and of turn, as shares); a landmark has two. An error is true minus estimated, added to
each number; what has no variance is not estimated. range = (1 + κ) ‖q − p‖ + ρ, bearing = angle(q − p) − heading + β.

The modes differ in two places only:

* EKF: all as it stands. With more than one linearisation it is the iterated filter.
* FEJ: Jacobians at first estimates: of a landmark where it was first put, of a robot where it was last predicted (Huang, Mourikis, Roumeliotis 2010).
* INVARIANT: the right-invariant error of each robot, landmarks tied to the robot that measures (Barrau & Bonnabel 2015; Zhang et al. 2017). Written
  in the plain error: prediction is the same, and after an update that moved a position by Δ, the error there gains JΔ times the
  heading's error (`transport`). So a turn of the whole world stays a direction without information, whatever the estimates: J p for all positions p.
* BOUND: Jacobians at the truth, which the mean is then made to follow: the recursion of the posterior Cramér-Rao bound (Tichavský et al. 1998).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from tracker.geometry import Array

EKF, FEJ, INVARIANT, BOUND = 0, 1, 2, 3
MODES = {"ekf": EKF, "iekf": EKF, "fej": FEJ, "invariant": INVARIANT}
"""By name; the EKF has one linearisation, whatever is asked for."""
ROBOT = 8
"""Numbers of a robot: x, y, heading, bearing offset β, range offset ρ, range scale κ, speed scale, turn scale."""
MATCHED, OUTLIER, REOPENED, STARTED, EVENT = range(5)
"""Places in State.tally: sightings that counted, those that lost nearly all weight, gates opened again, landmarks started, the present event."""


STEP, SCAN, MARK = 0, 1, 2
"""Kinds of events: a robot moves, a robot looks, the team's poses are noted."""


class PlanarState(NamedTuple):
    """mean (n,), P (n, n), first (n,): first estimates; known (landmarks,): whether it was seen; streak (robots,): bad sightings of late, more than
    good ones; tally: counts by the places above.
    """

    mean: Array
    P: Array
    first: Array
    known: NDArray[np.bool_]
    streak: NDArray[np.int64]
    tally: NDArray[np.int64]


class FilterSettings(NamedTuple):
    """mode, iterations; robust: standard deviations of a residual beyond which it loses weight; reopen: bad sightings of a robot, more
    than good ones, after which its pose is doubted by doubt (m, rad); truth (landmarks, 2): where BOUND starts them.
    """

    mode: int
    iterations: int
    robust: float
    curved: float
    reopen: int
    doubt: tuple[float, float]
    truth: Array


class EventSchedule(NamedTuple):
    """Events in order: kind, robot, item (e,). Steps: motion (m, 2) m, rad and noise (m, 8) as predict takes them. Scan k has the rows
    start[k] to start[k + 1] of subject (z,), z (z, 2) m, rad, and sigma (z, 2). time (e,) s; marks: how many there are.
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
    marks: int


class Scan(NamedTuple):
    """What one robot saw at once: subject (k,) is a robot's number or the number of robots plus a landmark's; z (k, 2) m, rad; sigma (k, 2)."""

    subject: NDArray[np.int64]
    z: Array
    sigma: Array


@njit(cache=True)
def wrapped(angle: float) -> float:
    """rad → [−π, π)."""
    return (angle + np.pi) % (2 * np.pi) - np.pi


@njit(cache=True)
def linearise(s: Any, who: Any, z: Any, H: Any) -> Any:
    """Fill H (2, n), and return z − h (2,) m, rad; who = (whether Jacobians are those of first estimates, the robot's and the subject's columns)."""
    fej, at, to = who
    x = s.mean
    dx, dy = x[to] - x[at], x[to + 1] - x[at + 1]
    residual = np.array([z[0] - (1 + x[at + 5]) * np.hypot(dx, dy) - x[at + 4], wrapped(z[1] - np.arctan2(dy, dx) + x[at + 2] - x[at + 3])])
    if fej:
        dx, dy = s.first[to] - s.first[at], s.first[to + 1] - s.first[at + 1]
    r2 = max(dx * dx + dy * dy, 1e-6)
    r = np.sqrt(r2)
    ex, ey = (1 + x[at + 5]) * dx / r, (1 + x[at + 5]) * dy / r
    H[0, at], H[0, at + 1], H[0, to], H[0, to + 1], H[0, at + 4], H[0, at + 5] = -ex, -ey, ex, ey, 1.0, r
    H[1, at], H[1, at + 1], H[1, to], H[1, to + 1], H[1, at + 2], H[1, at + 3] = dy / r2, -dx / r2, -dy / r2, dx / r2, -1.0, 1.0
    return residual


@njit(cache=True)
def place(s: Any, who: Any, z: Any, sigma: Any) -> Any:
    """Put the landmark's mean where z shows it, and return G (2, 6), its derivative by the robot's x, y, heading, β, ρ, κ, and the part of its
    covariance (2, 2) m² that is the measurement's own. A negative column −to of the landmark leaves the mean as it is.
    """
    fej, at, to = who
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
    """The first number of a subject in the state."""
    return ROBOT * min(subject, robots) + 2 * max(subject - robots, 0)


@njit(cache=True)
def predict(s: Any, fej: bool, at: int, motion: Any, noise: Any) -> None:
    """Move the robot whose numbers begin at `at` by motion = (m along its way, rad turned) as odometry says, along an arc.

    noise: variances of the way, across it, of the turn (m², m², rad²), then what the last five numbers gain (rad², m², shares²).
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
def update(s: Any, rule: Any, robot: int, scan: Any) -> Any:
    """Take in what `robot` sees of known subjects by rule.iterations linearisations; their weights (k,). P in Joseph's form.

    rᵢ = z − h(xᵢ) + Hᵢ δᵢ with xᵢ = x⁻ ⊞ δᵢ and Hᵢ the derivative by δ (Bell & Cathey 1993).
    """
    k, robots = len(scan.z), len(s.streak)
    prior, delta, weight = s.mean.copy(), np.zeros(len(s.mean)), np.ones(k)
    sigma = scan.sigma.ravel() if rule.curved == 0 else blurred(s, rule, ROBOT * robot, scan).ravel()
    HP, K, S = np.zeros((2 * k, len(delta))), np.zeros((len(delta), 2 * k)), np.zeros((2 * k, 2 * k))
    for _ in range(rule.iterations):
        H, residual = np.zeros((2 * k, len(delta))), np.zeros(2 * k)
        for i in range(k):
            to = column(robots, scan.subject[i])
            residual[2 * i : 2 * i + 2] = linearise(s, (rule.mode == FEJ, ROBOT * robot, to), scan.z[i], H[2 * i : 2 * i + 2])
            if rule.mode == INVARIANT:
                _tie(H[2 * i : 2 * i + 2], ROBOT * robot, ROBOT * robot + 2, s.mean - prior)
                _tie(H[2 * i : 2 * i + 2], to, (to if to < ROBOT * robots else ROBOT * robot) + 2, s.mean - prior)
        HP = H @ s.P
        spread = HP @ H.T
        innovation = residual + H @ delta
        weight = reweigh(spread, sigma, innovation, rule.robust)
        S = spread + np.diag(sigma**2 / np.repeat(weight, 2))
        K = np.ascontiguousarray(np.linalg.solve(S, HP).T)
        delta = K @ innovation
        if rule.mode != BOUND:
            retract(s, rule.mode == INVARIANT, robot, (prior, delta))
    U = HP.T - 0.5 * (K @ S)
    gain = K @ np.ascontiguousarray(U.T)
    s.P[:] = s.P - gain - gain.T
    if rule.mode == INVARIANT:
        transport(s, robot, s.mean - prior)
    return weight


@njit(cache=True)
def blurred(s: Any, rule: Any, at: int, scan: Any) -> Any:
    """The deviations (k, 2) of sightings, wider by the share `curved` of what the bend of range and bearing adds: with v m² the variance of the
    subject's place seen from the robot, the second derivatives 1/r and 1/r² leave about v/(√2 r) m and v/(√2 r²) rad that no first order sees.
    Jacobians at first estimates are off by as much as these have moved, too.
    """
    sigma, P = scan.sigma.copy(), s.P
    for i in range(len(sigma)):
        to = column(len(s.streak), scan.subject[i])
        v = 0.0
        for axis in range(2):
            a, b = at + axis, to + axis
            v += P[a, a] + P[b, b] - 2 * P[a, b]
        r = np.hypot(s.mean[to] - s.mean[at], s.mean[to + 1] - s.mean[at + 1])
        if rule.mode == FEJ:
            dx, dy = s.first[to] - s.first[at], s.first[to + 1] - s.first[at + 1]
            v += (dx - s.mean[to] + s.mean[at]) ** 2 + (dy - s.mean[to + 1] + s.mean[at + 1]) ** 2
            r = min(r, np.hypot(dx, dy))
        r = max(r, 0.05)
        bend = rule.curved * max(v, 0.0) / (np.sqrt(2.0) * r)
        sigma[i, 0], sigma[i, 1] = np.hypot(sigma[i, 0], bend), np.hypot(sigma[i, 1], bend / r)
    return sigma


@njit(cache=True)
def _tie(H: Any, at: int, heading: int, moved: Any) -> None:
    """A turn of the heading takes along what the position at `at` has moved by."""
    for row in range(2):
        H[row, heading] += H[row, at + 1] * moved[at] - H[row, at] * moved[at + 1]


@njit(cache=True)
def retract(s: Any, invariant: bool, robot: int, change: Any) -> None:
    """mean ← prior ⊞ δ, change = (prior, δ): sums, or for the invariant error positions by V(δθ) δp, which is the exponential of SE(2) applied
    to R(δθ) p + V(δθ)(δp − δθ J p) multiplied out; a landmark goes with the heading of `robot`.
    """
    prior, delta = change
    s.mean[:] = prior + delta
    if not invariant:
        return
    team = ROBOT * len(s.streak)
    for at in list(range(0, team, ROBOT)) + list(range(team, len(prior), 2)):
        angle = delta[(at if at < team else ROBOT * robot) + 2]
        sine, cosine = 1 - angle**2 / 6, angle / 2
        if abs(angle) > 1e-4:
            sine, cosine = np.sin(angle) / angle, (1 - np.cos(angle)) / angle
        s.mean[at] = prior[at] + sine * delta[at] - cosine * delta[at + 1]
        s.mean[at + 1] = prior[at + 1] + cosine * delta[at] + sine * delta[at + 1]


@njit(cache=True)
def transport(s: Any, robot: int, moved: Any) -> None:
    """P ← M P Mᵀ after the mean has moved by `moved` (n,): each position's error gains J moved times its heading's error."""
    team, P = ROBOT * len(s.streak), s.P
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
def reweigh(spread: Any, sigma: Any, innovation: Any, threshold: float) -> Any:
    """gaussian.robust_weights for pairs with independent noise sigma (2k,): the weights (k,)."""
    k = len(sigma) // 2
    weight = np.ones(k)
    if not np.isfinite(threshold):
        return weight
    for _ in range(4):
        noise = sigma**2 / np.repeat(weight, 2)
        force = np.linalg.solve(spread + np.diag(noise), innovation)
        size = (sigma * force).reshape(k, 2) / weight.reshape(k, 1)
        square = np.maximum((size**2).sum(axis=1), 1e-24)
        weight = np.maximum(np.minimum(1.0, threshold**2 / square), 1e-6)
    return weight


@njit(cache=True)
def start_landmark(s: Any, rule: Any, robot: int, scan: Any, i: int) -> None:
    """Put the unknown landmark of sighting i into the state by the inverse model."""
    robots = len(s.streak)
    to, at = column(robots, scan.subject[i]), ROBOT * robot
    G, own = place(s, (rule.mode == FEJ, at, to), scan.z[i], scan.sigma[i])
    if rule.mode == BOUND:
        s.mean[to : to + 2] = rule.truth[scan.subject[i] - robots]
        G, own = place(s, (False, at, -to), scan.z[i], scan.sigma[i])
    s.first[to : to + 2] = s.mean[to : to + 2]
    cross = G @ s.P[at : at + 6]
    s.P[to : to + 2], s.P[:, to : to + 2] = cross, cross.T
    s.P[to : to + 2, to : to + 2] = np.ascontiguousarray(cross[:, at : at + 6]) @ np.ascontiguousarray(G.T) + own
    s.known[scan.subject[i] - robots] = True
    s.tally[STARTED] += 1


@njit(cache=True)
def look(s: Any, rule: Any, robot: int, scan: Any) -> None:
    """A whole scan: update by what is known, open the gate again where too much was bad of late, then start what is new."""
    robots, at = len(s.streak), ROBOT * robot
    new = np.array([subject >= robots and not s.known[subject - robots] for subject in scan.subject])
    old = Scan(scan.subject[~new], scan.z[~new], scan.sigma[~new])
    if len(old.z):
        for weight in update(s, rule, robot, old):
            bad = weight < 0.1
            s.streak[robot] = max(s.streak[robot] + (1 if bad else -1), 0)
            s.tally[OUTLIER if bad else MATCHED] += 1
    if s.streak[robot] >= rule.reopen:
        s.streak[robot] = 0
        s.tally[REOPENED] += 1
        for i in range(3):
            s.P[at + i, at + i] += rule.doubt[0] ** 2 if i < 2 else rule.doubt[1] ** 2
    for i in range(len(scan.z)):
        if new[i] and not s.known[scan.subject[i] - robots]:
            start_landmark(s, rule, robot, scan, i)


@njit(cache=True)
def run(s: Any, rule: Any, course: Any, out: Any) -> bool:
    path, spread = out
    mark = 0
    for e in range(len(course.kind)):
        robot, item = course.robot[e], course.item[e]
        s.tally[EVENT] = e
        at = ROBOT * robot
        if course.kind[e] == STEP:
            predict(s, rule.mode == 1, at, course.motion[item], course.noise[item])
        elif course.kind[e] == SCAN:
            rows = slice(course.start[item], course.start[item + 1])
            look(s, rule, robot, Scan(course.subject[rows], course.z[rows], course.sigma[rows]))
            if not (np.isfinite(s.mean).all() and np.isfinite(s.P[at, at])):
                return False
        else:
            for i in range(len(s.streak)):
                path[mark, i] = s.mean[ROBOT * i : ROBOT * i + 3]
                spread[mark, i] = s.P[ROBOT * i : ROBOT * i + 3, ROBOT * i : ROBOT * i + 3]
            mark += 1
    return True
