"""Kalman filters of people whose identities are known: one filter of planar position and velocity per person, compiled.

Detections are drawn with the probabilities of the detector, and have its errors (information.py).
Motion model: constant velocity (Bar-Shalom, Li and Kirubarajan 2001, section 6.3.2).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from sim.placement.information import ACCELERATION_DENSITY, LOST_SIGMA, VELOCITY_SIGMA, Views, detection_probability, sight, view_covariance
from tracker.geometry import Array, frozen
from tracker.geometry.compilation import njit


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
