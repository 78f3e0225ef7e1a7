"""What is believed of people who are told apart: a Kalman filter a person, of place and velocity in the plane. Compiled.

A view measures the direction to the feet and, by where they meet the ground, the distance: the worse the farther (an error of the elevation e of
a point h below the camera moves it by e (r² + h²) / h). Motion: constant velocity, Bar-Shalom, Li and Kirubarajan 2001, 6.3.2.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit

from tracker.geometry import Array, frozen

AZIMUTH, ELEVATION, PLACE = math.radians(0.5), math.radians(0.8), 0.08
"""Errors of a view of feet, one sigma: rad, rad (rough ground and feet that are half hidden included) and m an axis."""
ACCELERATION = 0.6
"""m²/s³: spectral density of what people do to their velocity."""
FASTEST = 1.2
"""m/s: the sigma of a velocity that nothing is known of, and a bound of its growth."""
LOST = 4.0
"""m: who may be anywhere within this (one sigma) is not known any more."""


@dataclass(frozen=True, eq=False)
class Beliefs:
    """Of p people: known (p,) 0 or 1; mean (p, 4) x, y m, vx, vy m/s; covariance (p, 4, 4)."""

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
        """`dt` s later; who is LOST by then is not known any more."""
        return Beliefs(*_predict(self.known, self.mean, self.covariance, dt))

    def updated(self, measured: Array, eyes: Array, views: Array) -> tuple[Beliefs, float]:
        """With the feet measured (r, p, 2) m from eyes (r, 3) m (x, y, height over the ground) where views (r, p) are above 0; and the information
        gained, nats: half of what log det of the places' covariances lost, summed; who was not known counts from LOST."""
        known, mean, covariance, gain = _update(self.known, self.mean, self.covariance, (measured, eyes, views))
        return Beliefs(known, mean, covariance), float(gain)


def measure(feet: Array, eyes: Array, rng: np.random.Generator) -> Array:
    """(r, p, 2) m: feet (p, 2) m as views from eyes (r, 3) m (x, y, height over the ground) measure them."""
    draws = rng.normal(size=(len(eyes), len(feet), 2))
    return _measure(feet, eyes, draws)


@njit(cache=True)
def _noise(dx, dy, height):  # type: ignore[no-untyped-def]
    r = math.sqrt(dx * dx + dy * dy) + 1e-9
    far = (ELEVATION * (r * r + height * height) / height) ** 2 + PLACE**2
    wide = (AZIMUTH * r) ** 2 + PLACE**2
    c, s = dx / r, dy / r
    out = np.empty((2, 2))
    out[0, 0], out[1, 1] = far * c * c + wide * s * s, far * s * s + wide * c * c
    out[0, 1] = out[1, 0] = (far - wide) * c * s
    return out


@njit(cache=True)
def _measure(feet, eyes, draws):  # type: ignore[no-untyped-def]
    out = np.empty(draws.shape)
    for r in range(len(eyes)):
        for p in range(len(feet)):
            R = _noise(eyes[r, 0] - feet[p, 0], eyes[r, 1] - feet[p, 1], eyes[r, 2])
            a = math.sqrt(R[0, 0])
            b = R[1, 0] / a
            c = math.sqrt(max(R[1, 1] - b * b, 0.0))
            out[r, p, 0] = feet[p, 0] + a * draws[r, p, 0]
            out[r, p, 1] = feet[p, 1] + b * draws[r, p, 0] + c * draws[r, p, 1]
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
            P[p, k, k] += ACCELERATION * dt**3 / 3
            P[p, k, k + 2] += ACCELERATION * dt**2 / 2
            P[p, k + 2, k] += ACCELERATION * dt**2 / 2
            P[p, k + 2, k + 2] += ACCELERATION * dt
        # Nobody runs off: a velocity that is not measured fades, and is never less known than at first.
        fade = math.exp(-dt / 6.0)
        grown = max(P[p, 2, 2], P[p, 3, 3])
        if grown > FASTEST**2:
            share = FASTEST / math.sqrt(grown)
            P[p, 2:, :] *= share
            P[p, :, 2:] *= share
        if grown > 0.5 * FASTEST**2:
            mean[p, 2:] *= fade
        if P[p, 0, 0] + P[p, 1, 1] > LOST**2:
            known[p] = 0.0
            mean[p], P[p] = 0.0, 0.0
    return known, mean, P


@njit(cache=True)
def _update(known, mean, covariance, seen):  # type: ignore[no-untyped-def]
    measured, eyes, views = seen
    known, mean, P = known.copy(), mean.copy(), covariance.copy()
    gain = 0.0
    for p in range(len(known)):
        before = P[p, 0, 0] * P[p, 1, 1] - P[p, 0, 1] ** 2 if known[p] else (LOST * LOST / 2) ** 2
        count = 0
        for r in range(len(eyes)):
            if views[r, p] <= 0:
                continue
            count += 1
            R = _noise(eyes[r, 0] - measured[r, p, 0], eyes[r, 1] - measured[r, p, 1], eyes[r, 2])
            if not known[p]:
                known[p] = 1.0
                mean[p, 0], mean[p, 1], mean[p, 2], mean[p, 3] = measured[r, p, 0], measured[r, p, 1], 0.0, 0.0
                P[p] = 0.0
                P[p, :2, :2] = R
                P[p, 2, 2] = P[p, 3, 3] = FASTEST**2
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
