"""Expected information about people on the ground, a team's beliefs about them, and the state of many episodes between decisions.

A detector finds a person with a probability that falls with distance and occlusion. A box measures azimuth and elevation of the feet,
and the ground gives the distance. The Fisher information of a view is multiplied by the probability of detection
(information reduction factor: Niu, Willett and Bar-Shalom 2001, Matrix CRLB scaling due to measurements of uncertain origin).
The bound of each person follows the posterior Cramér-Rao recursion with this information (Tichavský, Muravchik and Nehorai 1998).
People move with nearly constant velocity (Bar-Shalom, Li and Kirubarajan 2001, section 6.2.2).
Robot poses have bounds of their own, from odometry and landmarks, which add to the covariance of a view.

States are arrays that compiled kernels change in place. Row n is episode n; a single environment has one row, and a batch shares the arrays.
Beliefs are Kalman filters of people whose identities are known: one filter of planar position and velocity per person.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.placement.config import TRAVELLED, TURNED, YAW, PlacementConfig, X, Y
from sim.placement.roadmap import nearest_node
from sim.robots.odometry import GYRO_BIAS, GYRO_SCALE
from tracker.detector_models.independent import IndependentErrors
from tracker.detector_models.model import KNOTS, Model
from tracker.detector_models.processes import persistence
from tracker.geometry import Array
from tracker.geometry.compilation import njit
from worlds.terrain.heightfield import Mask

TRAIL_LENGTH = 60
"""Number of decisions that a trail covers."""
TERMS: dict[str, str] = {
    "information": "expected information about the place of a person, nats: ½ log det of an unknown place over the bound, the mean over people",
    "seen": "share of people whom at least one robot sees, in [0, 1]",
    "seen_twice": "share of people whom at least two robots see, in [0, 1]",
    "collisions": "robots stopped by a person, by another robot or by the ground in this decision",
    "near_misses": "people within 0.98 m of a moving robot",
    "tip_overs": "robots that tipped over in this decision",
    "energy": "energy spent by all robots, kJ",
}
"""Every term of the reward and its meaning."""
INFORMATION, SEEN, SEEN_TWICE, COLLISIONS, NEAR_MISSES, TIP_OVERS, ENERGY = range(7)
"""Columns of the terms, in the order of TERMS."""
ACCELERATION_DENSITY = 0.6
"""Spectral density of the acceleration of people, per axis, m²/s³."""
VELOCITY_SIGMA = 1.2
"""Standard deviation of an unknown velocity, and the bound of its growth, m/s."""
LOST_SIGMA = 4.0
"""Standard deviation of the position beyond which a person counts as unknown, m."""
POSITION_SIGMA = 0.08
"""Standard deviation per axis of the feet from the ground point of a box, due to rough ground and strides, m."""
START_SIGMA = (0.01, 0.005)
"""Standard deviations of the start pose of a robot: per axis (m) and of its heading (rad)."""
SLIP = 0.02
"""Relative standard deviation of the distance that wheels measure."""
LANDMARK_SIGMA = 0.05
"""Standard deviation of a landmark in the map of a team, m."""
CORRELATION_CAP = 0.95
"""Upper limit of the correlation of errors from frame to frame."""
CONSTANT, HIDDEN, MOSTLY_HIDDEN, SIZE, LOW, HIGH, MISSES, LEAST_SHARE, ACROSS, UP, EDGE = range(11)
"""Columns of the parameters of a detector.

They are coefficients of the log odds of a miss, bounds of log2 (apparent height / π), least miss rate, and least visible share.
ACROSS and UP are standard deviations of the middle and of the lower edge of a box, in apparent heights. EDGE is that of an edge, rad.
"""


class States(NamedTuple):
    """n episodes of r robots among p people.

    team, before (n, r, 7): rovers now and at the last decision, in the columns of config.py. body (n, p, 10): people, as in social_force.py.
    time (n,) s. known (n, p), mean (n, p, 4), covariance (n, p, 4, 4): beliefs. bounds (n, p, 4, 4), robot_bounds (n, r, 3, 3): Cramér-Rao.
    time_unseen (n, p): since each person was last seen, s. people (n, p, 4): feet x, y, z m and stature m. cameras (n, r, 3): positions, m.
    seen (n, r, p): shares of bodies seen. stopped (n, r): what stopped a robot in the last decision, as in movers.drive_step.
    tipped, tipping (n, r): whether a robot had tipped over at the last observation, and has tipped over now.
    without (n, r, p, 4, 4): bounds of people as they would be if one robot had never seen anybody. added (n, r): what each robot adds to the
    information about a person, nats. terms (n, 7): of the last decision, in the columns of TERMS.
    noise (n, r, p, 2), luck (n, r, p): random numbers of the next views, normal and uniform.
    trail (n, TRAIL_LENGTH, r, 2): ring buffer of positions after the last decisions, m. decisions (n,): number of decisions so far.
    """

    team: Array
    before: Array
    body: Array
    time: Array
    known: Array
    mean: Array
    covariance: Array
    bounds: Array
    without: Array
    robot_bounds: Array
    time_unseen: Array
    people: Array
    cameras: Array
    seen: Array
    stopped: NDArray[np.int64]
    tipped: Mask
    tipping: Mask
    added: Array
    terms: Array
    noise: Array
    luck: Array
    trail: Array
    decisions: NDArray[np.int64]

    @staticmethod
    def begun(config: PlacementConfig, count: int, columns: int) -> States:
        """The arrays of `count` episodes before their first observation. columns: number of columns of a body."""
        n, r, p = count, config.robots, config.people
        shapes = {"team": (n, r, 7), "before": (n, r, 7), "body": (n, p, columns), "time": (n,), "known": (n, p), "mean": (n, p, 4)}
        shapes |= {"covariance": (n, p, 4, 4), "time_unseen": (n, p), "people": (n, p, 4), "cameras": (n, r, 3), "seen": (n, r, p), "added": (n, r)}
        shapes |= {"terms": (n, len(TERMS)), "noise": (n, r, p, 2), "luck": (n, r, p), "trail": (n, TRAIL_LENGTH, r, 2)}
        arrays: dict[str, Any] = {name: np.zeros(shape) for name, shape in shapes.items()}
        kinds = {"stopped": np.int64, "tipped": np.bool_, "tipping": np.bool_}
        arrays |= {name: np.zeros((n, r), dtype=kind) for name, kind in kinds.items()}
        bounds, robots = np.tile(unknown_people(p), (n, 1, 1, 1)), np.tile(started_robots(r), (n, 1, 1, 1))
        without = np.tile(bounds[:, None], (1, r, 1, 1, 1))
        return States(**arrays, bounds=bounds, without=without, robot_bounds=robots, decisions=np.zeros(n, dtype=np.int64))

    def copy_row(self, row: int, source: States, source_row: int) -> None:
        """Copy row `source_row` of other states into row `row`."""
        for mine, other in zip(self, source, strict=True):
            mine[row] = other[source_row]


class Beliefs(NamedTuple):
    """Estimates of p people: known (p,) 0 or 1; mean (p, 4) x, y m, vx, vy m/s; covariance (p, 4, 4)."""

    known: Array
    mean: Array
    covariance: Array

    @staticmethod
    def none(people: int) -> Beliefs:
        return Beliefs(np.zeros(people), np.zeros((people, 4)), np.zeros((people, 4, 4)))

    def predicted(self, dt: float) -> Beliefs:
        """The estimates `dt` s later. People whose position has a standard deviation above LOST_SIGMA become unknown."""
        return Beliefs(*predict(*self, dt))

    def observed(self, views: Views, rng: np.random.Generator) -> Beliefs:
        """The estimates after one frame of simulated measurements from views."""
        noise, luck = rng.normal(size=(*views.share.shape, 2)), rng.random(views.share.shape)
        return Beliefs(*update(*self, views, (noise, luck)))


@njit(cache=True, nogil=True)
def predict(known, mean, covariance, dt):  # type: ignore[no-untyped-def]
    """`Beliefs.predicted` as a kernel."""
    known, mean, P = known.copy(), mean.copy(), covariance.copy()
    F = np.eye(4)
    F[0, 2] = F[1, 3] = dt
    for p in range(len(known)):
        if known[p] == 0:
            continue
        mean[p, 0] += dt * mean[p, 2]
        mean[p, 1] += dt * mean[p, 3]
        P[p] = F @ P[p] @ F.T
        for k in range(2):
            P[p, k, k] += ACCELERATION_DENSITY * dt**3 / 3
            P[p, k, k + 2] += ACCELERATION_DENSITY * dt**2 / 2
            P[p, k + 2, k] += ACCELERATION_DENSITY * dt**2 / 2
            P[p, k + 2, k + 2] += ACCELERATION_DENSITY * dt
        # An unmeasured velocity decays, and its variance is bounded, since people change direction after some seconds.
        decay = math.exp(-dt / 6.0)
        variance = max(P[p, 2, 2], P[p, 3, 3])
        if variance > VELOCITY_SIGMA**2:
            share = VELOCITY_SIGMA / math.sqrt(variance)
            P[p, 2:, :] *= share
            P[p, :, 2:] *= share
        if variance > 0.5 * VELOCITY_SIGMA**2:
            mean[p, 2:] *= decay
        if P[p, 0, 0] + P[p, 1, 1] > LOST_SIGMA**2:
            known[p] = 0.0
            mean[p], P[p] = 0.0, 0.0
    return known, mean, P


@njit(cache=True, nogil=True)
def update(known, mean, covariance, views, drawn):  # type: ignore[no-untyped-def]
    """`Beliefs.observed` as a kernel. drawn: standard normal (r, p, 2), and uniform in [0, 1] (r, p)."""
    known, mean, P = known.copy(), mean.copy(), covariance.copy()
    noise, luck = drawn
    for p in range(len(known)):
        for r in range(len(views.cameras)):
            share = views.share[r, p]
            if share <= 0.0:
                continue
            away, direction = sight(views, r, p)
            if luck[r, p] >= detection_probability(views.detector, share, away):
                continue
            xx, xy, yy = view_covariance(views.detector, views.robots[r], away, direction, share)
            a = math.sqrt(xx)
            b, c = xy / a, math.sqrt(max(yy - xy * xy / xx, 0.0))
            x = views.people[p, 0] + a * noise[r, p, 0]
            y = views.people[p, 1] + b * noise[r, p, 0] + c * noise[r, p, 1]
            if known[p] == 0:
                known[p] = 1.0
                mean[p, 0], mean[p, 1], mean[p, 2], mean[p, 3] = x, y, 0.0, 0.0
                P[p] = 0.0
                P[p, 0, 0], P[p, 0, 1], P[p, 1, 0], P[p, 1, 1] = xx, xy, xy, yy
                P[p, 2, 2] = P[p, 3, 3] = VELOCITY_SIGMA**2
            else:
                _correct(mean[p], P[p], (x, y), (xx, xy, yy))
    return known, mean, P


@njit(cache=True)
def _correct(mean, P, measured, noise):  # type: ignore[no-untyped-def]
    """Correct mean (4,) and P (4, 4) in place by a measured position, m, of covariance (xx, xy, yy) m²."""
    s00, s01, s11 = P[0, 0] + noise[0], P[0, 1] + noise[1], P[1, 1] + noise[2]
    det = s00 * s11 - s01 * s01
    dx, dy = measured[0] - mean[0], measured[1] - mean[1]
    rows = P[:2].copy()
    for i in range(4):
        u, v = (rows[0, i] * s11 - rows[1, i] * s01) / det, (rows[1, i] * s00 - rows[0, i] * s01) / det
        mean[i] += u * dx + v * dy
        for j in range(i + 1):
            P[i, j] -= u * rows[0, j] + v * rows[1, j]
            P[j, i] = P[i, j]


class Views(NamedTuple):
    """Views of p people by r robots.

    detector (11,): columns above. robots (r, 3, 3): bounds of poses. share (r, p): visible share of each body; 0 beyond the limits.
    cameras (r, 3): x, y and height above the ground, m. people (p, 4): feet x, y, z and stature, m.
    """

    detector: Array
    robots: Array
    share: Array
    cameras: Array
    people: Array


def detector_of(model: Model, period: float) -> Array:
    """The parameters (11,) of a detector model for kernels, in the columns above. period: between frames, s.

    Errors of a fitted model persist. The variance is that of independent errors whose mean over many frames is equally uncertain.
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
    """Probability that a person is detected. share: visible share of the body. away: horizontal distance, camera height, stature, m."""
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
    """Covariance (xx, xy, yy) m² of the position that a box measures.

    robot (3, 3): pose covariance. away: horizontal distance, camera height, stature, m. direction: unit vector to the person. share: visible share.
    """
    r, height = max(away[0], 0.3), max(away[1], 0.2)
    apparent = _apparent_height(away)
    across = (detector[ACROSS] * apparent) ** 2 + 0.5 * detector[EDGE] ** 2
    up = ((detector[UP] * apparent) ** 2 + detector[EDGE] ** 2) / max(share, 0.1)
    radial = up * ((r * r + height * height) / height) ** 2 + POSITION_SIGMA**2
    tangential = across * r * r + POSITION_SIGMA**2
    c, s = direction
    # A heading error ψ moves the measured position by ψ r tangentially.
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
        # Both triangles get the same numbers: asymmetric rounding errors would grow from step to step.
        for j in range(i + 1):
            P[i, j] -= u * rows[0, j] + v * rows[1, j]
            P[j, i] = P[i, j]


@njit(cache=True)
def nats(P):  # type: ignore[no-untyped-def]
    """Information, nats, about the position of a person with bound P (4, 4): ½ log (det U / det P), with U of an unknown position.

    POSITION_SIGMA² is added to both variances, so that accuracy below the size of a foot adds little.
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
        # F P Fᵀ: a heading error ψ moves the end of the step sideways by ψ times its length.
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
    """Distance, camera height and stature, m, of person p as seen by robot r, and the unit vector to the person."""
    dx, dy = views.people[p, 0] - views.cameras[r, 0], views.people[p, 1] - views.cameras[r, 1]
    distance = math.sqrt(dx * dx + dy * dy) + 1e-9
    return (distance, views.cameras[r, 2], views.people[p, 3]), (dx / distance, dy / distance)


@njit(cache=True)
def add_information(bounds, without, views, step):  # type: ignore[no-untyped-def]
    """Bounds (p, 4, 4) of people after a decision, in place. Returns the mean information about a person, nats, and each robot's contribution (r,).

    without (r, p, 4, 4): bounds without any view of one robot since the start, changed in place. The contribution is what the team loses with them.
    So its sum over time differs from that of the team's information by what the robot cannot change. step: s since the last decision, and frames.
    """
    total, J, added = 0.0, np.zeros((len(views.cameras), 2, 2)), np.zeros(len(views.cameras))
    for p in range(len(views.people)):
        if step[0] > 0:
            predict_person(bounds[p], step[0])
        J[:] = 0.0
        for r in range(len(views.cameras)):
            if views.share[r, p] > 0.0:
                away, direction = sight(views, r, p)
                add_view(views.detector, views.robots[r], away, direction, views.share[r, p], J[r])
        every = J.sum(axis=0)
        update_person(bounds[p], every * step[1])
        found = nats(bounds[p])
        total += found
        for r in range(len(views.cameras)):
            if step[0] > 0:
                predict_person(without[r, p], step[0])
            update_person(without[r, p], (every - J[r]) * step[1])
            added[r] += found - nats(without[r, p])
    count = max(len(views.people), 1)
    return total / count, added / count
