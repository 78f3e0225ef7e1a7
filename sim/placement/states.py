"""The state of many episodes between decisions, as arrays that compiled kernels change in place. Row n is episode n.

A single environment has one row. Environments of a batch share the arrays, so that one call of a kernel advances all that have the same map.
Beliefs are Kalman filters of people whose identities are known: one filter of planar position and velocity per person.
Detections are drawn with the probabilities of the detector, and have its errors (information.py).
Motion model: constant velocity (Bar-Shalom, Li and Kirubarajan 2001, section 6.3.2).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.placement.config import PlacementConfig
from sim.placement.information import (
    ACCELERATION_DENSITY,
    LOST_SIGMA,
    VELOCITY_SIGMA,
    Views,
    detection_probability,
    sight,
    started_robots,
    unknown_people,
    view_covariance,
)
from tracker.geometry import Array, frozen
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


class States(NamedTuple):
    """n episodes of r robots among p people.

    team, before (n, r, 7): rovers now and at the last decision, in the columns of config.py. body (n, p, 10): people, as in social_force.py.
    time (n,) s. known (n, p), mean (n, p, 4), covariance (n, p, 4, 4): beliefs. bounds (n, p, 4, 4), robot_bounds (n, r, 3, 3): information.py.
    time_unseen (n, p): since each person was last seen, s. people (n, p, 4): feet x, y, z m and stature m. cameras (n, r, 3): positions, m.
    seen (n, r, p): shares of bodies seen. stopped (n, r): what stopped a robot in the last decision, as in movers.drive_step.
    tipped, tipping (n, r): whether a robot had tipped over when it last looked, and has now.
    added (n, r): what each robot adds to the information about a person, nats. terms (n, 7): of the last decision, in the columns of TERMS.
    noise (n, r, p, 2), luck (n, r, p): random numbers of the next views, normal and uniform.
    trail (n, TRAIL_LENGTH, r, 2): places after the last decisions, m, in turn. decisions (n,): their number.
    """

    team: Array
    before: Array
    body: Array
    time: Array
    known: Array
    mean: Array
    covariance: Array
    bounds: Array
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
        """The arrays of `count` episodes before their first look. columns: of a body."""
        n, r, p = count, config.robots, config.people
        shapes = {"team": (n, r, 7), "before": (n, r, 7), "body": (n, p, columns), "time": (n,), "known": (n, p), "mean": (n, p, 4)}
        shapes |= {"covariance": (n, p, 4, 4), "time_unseen": (n, p), "people": (n, p, 4), "cameras": (n, r, 3), "seen": (n, r, p), "added": (n, r)}
        shapes |= {"terms": (n, len(TERMS)), "noise": (n, r, p, 2), "luck": (n, r, p), "trail": (n, TRAIL_LENGTH, r, 2)}
        arrays: dict[str, Any] = {name: np.zeros(shape) for name, shape in shapes.items()}
        kinds = {"stopped": np.int64, "tipped": np.bool_, "tipping": np.bool_}
        arrays |= {name: np.zeros((n, r), dtype=kind) for name, kind in kinds.items()}
        bounds, robots = np.tile(unknown_people(p), (n, 1, 1, 1)), np.tile(started_robots(r), (n, 1, 1, 1))
        return States(**arrays, bounds=bounds, robot_bounds=robots, decisions=np.zeros(n, dtype=np.int64))

    def copy_row(self, row: int, source: States, source_row: int) -> None:
        """Take an episode of other states."""
        for mine, other in zip(self, source, strict=True):
            mine[row] = other[source_row]


@dataclass(frozen=True, eq=False)
class Beliefs:
    """Estimates of p people: known (p,) 0 or 1; mean (p, 4) x, y m, vx, vy m/s; covariance (p, 4, 4)."""

    known: Array
    mean: Array
    covariance: Array

    def __post_init__(self) -> None:
        p = len(self.known)
        for name, shape in (("known", (p,)), ("mean", (p, 4)), ("covariance", (p, 4, 4))):
            object.__setattr__(self, name, frozen(getattr(self, name), shape, name))

    @staticmethod
    def none(people: int) -> Beliefs:
        return Beliefs(np.zeros(people), np.zeros((people, 4)), np.zeros((people, 4, 4)))

    def predicted(self, dt: float) -> Beliefs:
        """The estimates `dt` s later. People of a standard deviation above LOST_SIGMA become unknown."""
        return Beliefs(*predict(self.known, self.mean, self.covariance, dt))

    def observed(self, views: Views, rng: np.random.Generator) -> Beliefs:
        """The estimates after a frame of simulated measurements of views."""
        noise, luck = rng.normal(size=(*views.share.shape, 2)), rng.random(views.share.shape)
        return Beliefs(*update(self.known, self.mean, self.covariance, views, (noise, luck)))


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
        # An unmeasured velocity decays, and its variance stays bounded: people do not run away.
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
