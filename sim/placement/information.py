"""Expected information about people on the ground: what the views of a team tell of their places, without rendering or tracking.

A detector finds a person with a probability that falls with distance and with what is hidden. A box measures azimuth and elevation of the feet,
and the ground gives the distance. An unknown detection multiplies the Fisher information of a view by its probability
(information reduction factor: Niu, Willett and Bar-Shalom 2001, Matrix CRLB scaling due to measurements of uncertain origin).
The bound of each person is the posterior Cramér-Rao recursion with it (Tichavský, Muravchik and Nehorai 1998).
People move with nearly constant velocity (Bar-Shalom, Li and Kirubarajan 2001, section 6.2.2).
Poses of robots have a bound of their own, by odometry and landmarks, and a view passes its errors on.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from sim.placement.config import TRAVELLED, TURNED, YAW, X, Y
from sim.placement.roadmap import nearest_node
from sim.robots.odometry import GYRO_BIAS, GYRO_SCALE
from tracker.detector_models.independent import IndependentErrors
from tracker.detector_models.model import KNOTS, Model
from tracker.detector_models.processes import persistence
from tracker.geometry import Array
from tracker.geometry.compilation import njit

ACCELERATION_DENSITY = 0.6
"""Spectral density of the acceleration of people, m²/s³."""
VELOCITY_SIGMA = 1.2
"""Standard deviation of an unknown velocity, and the bound of its growth, m/s."""
LOST_SIGMA = 4.0
"""Standard deviation of the position beyond which a person counts as unknown, m."""
POSITION_SIGMA = 0.08
"""Standard deviation of feet about the ground point that a box shows, per axis: rough ground, strides, m."""
START_SIGMA = (0.01, 0.005)
"""Standard deviations of the start of a robot: per axis (m) and of its heading (rad)."""
SLIP = 0.02
"""Standard deviation of the distance that wheels measure, over the distance."""
LANDMARK_SIGMA = 0.05
"""Standard deviation of a landmark in the map of a team, m."""
CORRELATION_CAP = 0.95
"""Largest correlation of errors from frame to frame that is counted."""
CONSTANT, HIDDEN, MOSTLY_HIDDEN, SIZE, LOW, HIGH, MISSES, LEAST_SHARE, ACROSS, UP, EDGE = range(11)
"""Columns of a detector.

They are coefficients of the logarithmic odds of a miss, bounds of log2 of apparent height over π, least share of misses, and least visible share.
ACROSS and UP are standard deviations of the middle and the lower edge, in apparent heights. EDGE is that of an edge, rad.
"""


class Views(NamedTuple):
    """What r robots see of p people.

    detector (11,): columns above. robots (r, 3, 3): bounds of poses. share (r, p): of each body that is visible; 0 beyond the limits.
    cameras (r, 3): x, y and height above the ground, m. people (p, 4): feet x, y, z and stature, m.
    """

    detector: Array
    robots: Array
    share: Array
    cameras: Array
    people: Array


def detector_of(model: Model, period: float) -> Array:
    """A detector model as kernels take it (11,), in the columns above. period: of its frames, s.

    Errors of a fitted model persist. Their variance is that of independent errors with the same mean over many frames.
    """
    out = np.zeros(11)
    if isinstance(model, IndependentErrors):
        out[[CONSTANT, MISSES, LEAST_SHARE, EDGE]] = -50.0, model.misses, model.min_visible, model.noise
        return out
    out[: SIZE + 1] = model.misses.coefficients[:4]
    out[[LOW, HIGH]] = model.misses.sizes
    out[LEAST_SHARE] = 0.02
    for column, term in ((ACROSS, 0), (UP, 3)):
        table = np.array(model.edges.quantiles[0][term])
        variance = float(np.interp((np.arange(1000) + 0.5) / 1000 * (KNOTS - 1), np.arange(KNOTS), table).var())
        lasting = model.edges.lasting[term]
        rho = min(lasting + (1 - lasting) * persistence(model.edges.time_s[term], period), CORRELATION_CAP)
        out[column] = math.sqrt(variance * (1 + rho) / (1 - rho))
    return out


def unknown_people(count: int) -> Array:
    """Bounds (count, 4, 4) of people of whom nothing is known: x, y, m, and velocity, m/s."""
    return np.tile(np.diag([LOST_SIGMA**2 / 2, LOST_SIGMA**2 / 2, VELOCITY_SIGMA**2, VELOCITY_SIGMA**2]), (count, 1, 1))


def started_robots(count: int) -> Array:
    """Bounds (count, 3, 3) of robots at their starts: x, y m and yaw rad."""
    return np.tile(np.diag([START_SIGMA[0] ** 2, START_SIGMA[0] ** 2, START_SIGMA[1] ** 2]), (count, 1, 1))


@njit(cache=True)
def detection_probability(detector, share, away):  # type: ignore[no-untyped-def]
    """Probability that a box of a person is found. share: of the body that is visible. away: horizontal distance, camera height, stature, m."""
    if share < detector[LEAST_SHARE]:
        return 0.0
    hidden = 1.0 - share
    size = min(max(math.log2(_apparent_height(away) / math.pi), detector[LOW]), detector[HIGH])
    odds = detector[CONSTANT] + detector[HIDDEN] * hidden + detector[MOSTLY_HIDDEN] * max(hidden - 0.5, 0.0) + detector[SIZE] * size
    return 1.0 - max(detector[MISSES], 1.0 / (1.0 + math.exp(-odds)))


@njit(cache=True)
def _apparent_height(away):  # type: ignore[no-untyped-def]
    distance, height, stature = away
    return math.atan2(height, distance) + math.atan2(stature - height, distance)


@njit(cache=True)
def view_covariance(detector, robot, away, direction, share):  # type: ignore[no-untyped-def]
    """Covariance (xx, xy, yy) m² of the place that a box gives.

    robot (3, 3): of the pose. away: horizontal distance, camera height, stature, m. direction: unit vector to the person. share: of the body seen.
    """
    r, height = max(away[0], 0.3), max(away[1], 0.2)
    apparent = _apparent_height(away)
    across = (detector[ACROSS] * apparent) ** 2 + 0.5 * detector[EDGE] ** 2
    up = ((detector[UP] * apparent) ** 2 + detector[EDGE] ** 2) / max(share, 0.1)
    radial = up * ((r * r + height * height) / height) ** 2 + POSITION_SIGMA**2
    tangential = across * r * r + POSITION_SIGMA**2
    c, s = direction
    # A turn of the robot by ψ moves the place by ψ r across.
    tx, ty = -s * r, c * r
    xx = radial * c * c + tangential * s * s + robot[0, 0] + 2 * tx * robot[0, 2] + tx * tx * robot[2, 2]
    yy = radial * s * s + tangential * c * c + robot[1, 1] + 2 * ty * robot[1, 2] + ty * ty * robot[2, 2]
    xy = (radial - tangential) * c * s + robot[0, 1] + tx * robot[1, 2] + ty * robot[0, 2] + tx * ty * robot[2, 2]
    return xx, xy, yy


@njit(cache=True)
def add_view(detector, robot, away, direction, share, J):  # type: ignore[no-untyped-def]
    """Add the expected information of one frame of a view to J (2, 2), 1/m². Arguments as `view_covariance`."""
    probability = detection_probability(detector, share, away)
    if probability > 0.0:
        xx, xy, yy = view_covariance(detector, robot, away, direction, share)
        scale = probability / max(xx * yy - xy * xy, 1e-12)
        J[0, 0] += scale * yy
        J[1, 1] += scale * xx
        J[0, 1] -= scale * xy
        J[1, 0] -= scale * xy


@njit(cache=True)
def predict_person(P, dt):  # type: ignore[no-untyped-def]
    """The bound P (4, 4) of a person `dt` s later, in place. It never exceeds that of an unknown person."""
    for k in range(2):
        for j in range(4):
            P[k, j] += dt * P[k + 2, j]
        for j in range(4):
            P[j, k] += dt * P[j, k + 2]
        P[k, k] += ACCELERATION_DENSITY * dt**3 / 3
        P[k, k + 2] += ACCELERATION_DENSITY * dt**2 / 2
        P[k + 2, k] += ACCELERATION_DENSITY * dt**2 / 2
        P[k + 2, k + 2] += ACCELERATION_DENSITY * dt
    for first, limit in ((0, LOST_SIGMA**2 / 2), (2, VELOCITY_SIGMA**2)):
        for k in range(first, first + 2):
            if P[k, k] > limit:
                factor = math.sqrt(limit / P[k, k])
                P[k, :] *= factor
                P[:, k] *= factor


@njit(cache=True)
def update_person(P, J):  # type: ignore[no-untyped-def]
    """The bound P (4, 4) after information J (2, 2) about the position, in place: (P⁻¹ + Hᵀ J H)⁻¹."""
    a, b = 1.0 + J[0, 0] * P[0, 0] + J[0, 1] * P[1, 0], J[0, 0] * P[0, 1] + J[0, 1] * P[1, 1]
    c, d = J[1, 0] * P[0, 0] + J[1, 1] * P[1, 0], 1.0 + J[1, 0] * P[0, 1] + J[1, 1] * P[1, 1]
    det = a * d - b * c
    # M = (1 + J P)⁻¹ J
    m00, m01, m11 = (d * J[0, 0] - b * J[1, 0]) / det, (d * J[0, 1] - b * J[1, 1]) / det, (a * J[1, 1] - c * J[0, 1]) / det
    rows = P[:2, :].copy()
    for i in range(4):
        u, v = rows[0, i] * m00 + rows[1, i] * m01, rows[0, i] * m01 + rows[1, i] * m11
        # Both halves are the same numbers: errors of rounding that differ would grow from step to step.
        for j in range(i + 1):
            P[i, j] -= u * rows[0, j] + v * rows[1, j]
            P[j, i] = P[i, j]


@njit(cache=True)
def nats(P):  # type: ignore[no-untyped-def]
    """Information about the position of a person of bound P (4, 4), nats: ½ log det of an unknown position over it.

    Both have POSITION_SIGMA added. What is below the size of a foot is worth nothing.
    """
    least = POSITION_SIGMA * POSITION_SIGMA
    unknown = (LOST_SIGMA * LOST_SIGMA / 2 + least) ** 2
    return 0.5 * math.log(unknown / ((P[0, 0] + least) * (P[1, 1] + least) - P[0, 1] * P[1, 0]))


@njit(cache=True)
def move_robots(bounds, before, after, landmarks, dt):  # type: ignore[no-untyped-def]
    """Bounds (r, 3, 3) of poses after a decision of dt s, in place: odometry between states (r, 7), then landmarks.

    landmarks: nodes (n, 2) m of the roadmap, and the information (n, 3, 3) of all frames of a decision at each of them.
    """
    nodes, information = landmarks
    for r in range(len(after)):
        P, moved = bounds[r], after[r, TRAVELLED] - before[r, TRAVELLED]
        # F P Fᵀ, where a turn of the robot by ψ moves its last step by ψ across.
        ax, ay = before[r, Y] - after[r, Y], after[r, X] - before[r, X]
        P[0, 0] += 2 * ax * P[0, 2] + ax * ax * P[2, 2]
        P[1, 1] += 2 * ay * P[1, 2] + ay * ay * P[2, 2]
        P[0, 1] += ax * P[1, 2] + ay * P[0, 2] + ax * ay * P[2, 2]
        P[0, 2] += ax * P[2, 2]
        P[1, 2] += ay * P[2, 2]
        c, s = math.cos(after[r, YAW]), math.sin(after[r, YAW])
        along, aside = (0.001 + SLIP * moved) ** 2, (0.001 + 0.5 * SLIP * moved) ** 2
        P[0, 0] += along * c * c + aside * s * s
        P[1, 1] += along * s * s + aside * c * c
        P[0, 1] += (along - aside) * c * s
        P[2, 2] += (GYRO_BIAS * dt) ** 2 + (GYRO_SCALE * (after[r, TURNED] - before[r, TURNED])) ** 2
        P[1, 0], P[2, 0], P[2, 1] = P[0, 1], P[0, 2], P[1, 2]
        found = information[nearest_node(nodes, after[r, X], after[r, Y])[0]]
        P[:] = _inverse(_inverse(P) + found)


@njit(cache=True)
def _inverse(A):  # type: ignore[no-untyped-def]
    """The inverse of a symmetric matrix (3, 3), by its adjugate."""
    out = np.empty((3, 3))
    for i in range(3):
        for j in range(i + 1):
            a, b, c, d = (i + 1) % 3, (i + 2) % 3, (j + 1) % 3, (j + 2) % 3
            out[i, j] = A[c, a] * A[d, b] - A[c, b] * A[d, a]
            out[j, i] = out[i, j]
    return out / (A[0, 0] * out[0, 0] + A[0, 1] * out[0, 1] + A[0, 2] * out[0, 2])


@njit(cache=True)
def sight(views, r, p):  # type: ignore[no-untyped-def]
    """(Distance, camera height, stature, m) of person p before robot r, and the direction to it, a unit vector."""
    dx, dy = views.people[p, 0] - views.cameras[r, 0], views.people[p, 1] - views.cameras[r, 1]
    distance = math.sqrt(dx * dx + dy * dy) + 1e-9
    return (distance, views.cameras[r, 2], views.people[p, 3]), (dx / distance, dy / distance)


@njit(cache=True)
def add_information(bounds, views, step):  # type: ignore[no-untyped-def]
    """Bounds (p, 4, 4) of people after a decision, in place. Returns mean information about a person, nats, and what of it each robot adds (r,).

    What a robot adds is what is lost without its views of this decision. step: s since the last decision, and number of frames.
    """
    total, J, without = 0.0, np.zeros((len(views.cameras), 2, 2)), np.empty((4, 4))
    added = np.zeros(len(views.cameras))
    for p in range(len(views.people)):
        if step[0] > 0:
            predict_person(bounds[p], step[0])
        J[:] = 0.0
        for r in range(len(views.cameras)):
            if views.share[r, p] > 0.0:
                away, direction = sight(views, r, p)
                add_view(views.detector, views.robots[r], away, direction, views.share[r, p], J[r])
        update_person(bounds[p], J.sum(axis=0) * step[1])
        found = nats(bounds[p])
        total += found
        for r in range(len(views.cameras)):
            if views.share[r, p] > 0.0:
                without[:] = bounds[p]
                update_person(without, -step[1] * J[r])
                added[r] += found - nats(without)
    count = max(len(views.people), 1)
    return total / count, added / count
