"""Kalman filters of people whose identities are known: one filter of planar position and velocity per person, compiled.

A camera measures azimuth and elevation of the feet, and the ground gives their distance. An elevation error e of a point at the horizontal
distance r and h below the camera moves the point by e (r² + h²) / h.
Motion model: constant velocity (Bar-Shalom, Li and Kirubarajan 2001, section 6.3.2).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tracker.geometry import Array, frozen
from tracker.geometry.compilation import njit

AZIMUTH_SIGMA, ELEVATION_SIGMA, POSITION_SIGMA = math.radians(0.5), math.radians(0.8), 0.08
"""Standard deviations of a measurement of feet: azimuth (rad), elevation (rad), and position per axis (m).

The elevation includes rough ground and partly hidden feet.
"""
ACCELERATION_DENSITY = 0.6
"""Spectral density of the acceleration noise, m²/s³."""
VELOCITY_SIGMA = 1.2
"""Standard deviation of an unknown velocity, and the bound of its growth, m/s."""
LOST_SIGMA = 4.0
"""Standard deviation of the position beyond which a person counts as unknown, m."""


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
        return Beliefs(*_predict(self.known, self.mean, self.covariance, dt))

    def updated(self, measured: Array, cameras: Array, views: Array) -> tuple[Beliefs, float]:
        """The estimates after an update, and the information gain in nats.

        measured (r, p, 2) m: feet as measured by cameras (r, 3): x, y, height above the ground, m. Measurements with views (r, p)
        above 0 are used. The gain is half the decrease of log det of the position covariances, summed over people. An unknown person has the
        standard deviation LOST_SIGMA before the update.
        """
        known, mean, covariance, gain = _update(self.known, self.mean, self.covariance, (measured, cameras, views))
        return Beliefs(known, mean, covariance), float(gain)


def measure(feet: Array, cameras: Array, rng: np.random.Generator) -> Array:
    """(r, p, 2) m: simulated measurements of feet (p, 2) m by cameras (r, 3): x, y, height above the ground, m."""
    noise = rng.normal(size=(len(cameras), len(feet), 2))
    return _measure(feet, cameras, noise)


@njit(cache=True)
def _noise(dx, dy, height):  # type: ignore[no-untyped-def]
    r = math.sqrt(dx * dx + dy * dy) + 1e-9
    radial = (ELEVATION_SIGMA * (r * r + height * height) / height) ** 2 + POSITION_SIGMA**2
    tangential = (AZIMUTH_SIGMA * r) ** 2 + POSITION_SIGMA**2
    c, s = dx / r, dy / r
    out = np.empty((2, 2))
    out[0, 0], out[1, 1] = radial * c * c + tangential * s * s, radial * s * s + tangential * c * c
    out[0, 1] = out[1, 0] = (radial - tangential) * c * s
    return out


@njit(cache=True)
def _measure(feet, cameras, noise):  # type: ignore[no-untyped-def]
    out = np.empty(noise.shape)
    for r in range(len(cameras)):
        for p in range(len(feet)):
            R = _noise(cameras[r, 0] - feet[p, 0], cameras[r, 1] - feet[p, 1], cameras[r, 2])
            a = math.sqrt(R[0, 0])
            b = R[1, 0] / a
            c = math.sqrt(max(R[1, 1] - b * b, 0.0))
            out[r, p, 0] = feet[p, 0] + a * noise[r, p, 0]
            out[r, p, 1] = feet[p, 1] + b * noise[r, p, 0] + c * noise[r, p, 1]
    return out


@njit(cache=True)
def _predict(known, mean, covariance, dt):  # type: ignore[no-untyped-def]
    known, mean, P = known.copy(), mean.copy(), covariance.copy()
    for p in range(len(known)):
        if known[p] == 0:
            continue
        mean[p, 0] += dt * mean[p, 2]
        mean[p, 1] += dt * mean[p, 3]
        F = np.eye(4)
        F[0, 2] = F[1, 3] = dt
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


@njit(cache=True)
def _update(known, mean, covariance, seen):  # type: ignore[no-untyped-def]
    measured, cameras, views = seen
    known, mean, P = known.copy(), mean.copy(), covariance.copy()
    gain = 0.0
    for p in range(len(known)):
        before = P[p, 0, 0] * P[p, 1, 1] - P[p, 0, 1] ** 2 if known[p] else (LOST_SIGMA * LOST_SIGMA / 2) ** 2
        count = 0
        for r in range(len(cameras)):
            if views[r, p] <= 0:
                continue
            count += 1
            R = _noise(cameras[r, 0] - measured[r, p, 0], cameras[r, 1] - measured[r, p, 1], cameras[r, 2])
            if not known[p]:
                known[p] = 1.0
                mean[p, 0], mean[p, 1], mean[p, 2], mean[p, 3] = measured[r, p, 0], measured[r, p, 1], 0.0, 0.0
                P[p] = 0.0
                P[p, :2, :2] = R
                P[p, 2, 2] = P[p, 3, 3] = VELOCITY_SIGMA**2
                continue
            S = P[p, :2, :2] + R
            K = P[p, :, :2].copy() @ np.linalg.inv(S)
            mean[p] += K @ (measured[r, p] - mean[p, :2])
            P[p] -= K @ P[p, :2, :].copy()
            P[p] = 0.5 * (P[p] + P[p].T)
        if count:
            after = P[p, 0, 0] * P[p, 1, 1] - P[p, 0, 1] ** 2
            gain += 0.5 * math.log(max(before, 1e-12) / max(after, 1e-12))
    return known, mean, P, gain
