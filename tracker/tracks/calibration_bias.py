"""Registration bias: the constant offset of each view on the ground, estimated while tracking.

It comes from errors of the calibration, or from an unknown tilt of a robot. A bias has a value at the middle of the area and, for fixed
cameras, a slope. On PETS 2009 the places of two views differ by 0.3 m at one spot and by 0.8 m ten metres farther. The innovations of confirmed
tracks are its measurements (sensor registration: Bar-Shalom et al. 2011, Tracking and data fusion). Biases are observable relative to each other
only, so the first view has a tight prior.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tracker.geometry import Array
from tracker.geometry.compilation import njit
from tracker.types import Setup

SLOPE, SLOPE_FIRST = 0.03, 0.005
"""m/m, standard deviation of the slope of a bias over the ground, for fixed cameras; and of the first view's slope."""

CORRELATION = 30.0
"""Innovations that count as one independent measurement, as they are correlated over time."""


@dataclass(frozen=True)
class RegistrationBiasParameters:
    """Standard deviations of the priors."""

    sigma: float = 0.3  # m, of a view's bias; 0 switches the estimation off
    first: float = 0.05  # m, of the first view's bias; a small value reports places as that view sees them


class RegistrationBias:
    """Estimates of each camera: bias (2,) m at `centre` (2,) m, its derivative by x and y row by row, and the covariance (6, 6) of these six."""

    def __init__(self, setup: Setup, parameters: RegistrationBiasParameters) -> None:
        self.parameters, p = parameters, parameters
        fixed = [robot for robot in setup.starts if setup.is_fixed(robot)]
        places = setup.fixed_places
        self.centre = setup.area.mean(axis=0) if setup.area is not None else places.mean(axis=0) if len(places) else np.zeros(2)
        self._estimates: dict[str, tuple[Array, Array]] = {}
        for k, (camera, mount) in enumerate(setup.mounts.items()):
            sigma, slope = (p.sigma, SLOPE) if k else (min(p.first, p.sigma), SLOPE_FIRST)
            slope *= mount.robot in fixed and p.sigma > 0
            self._estimates[camera] = np.zeros(6), np.diag([sigma**2] * 2 + [slope**2] * 4)

    def of(self, camera: str) -> Array:
        """Bias m and its derivative, (6,)."""
        return self._estimates[camera][0]

    def at(self, camera: str, place: Array) -> Array:
        """Bias (n, 2) m of `camera` at places (n, 2) m."""
        bias = self.of(camera)
        return np.asarray(bias[:2] + (place - self.centre) @ bias[2:].reshape(2, 2).T)

    def learn(self, camera: str, place: Array, innovations: tuple[Array, Array, Array]) -> None:
        """Update the bias of a camera by innovations at places (k, 2) m (Kalman filter).

        innovations: residual (k, 2) or (k, 1), NaN where there is none, its derivative H by x and y, and its covariance S. S is inflated, as
        innovations are correlated.
        """
        if self.parameters.sigma > 0:
            self._estimates[camera] = _updated(self._estimates[camera], place - self.centre, innovations, CORRELATION)


@njit(cache=True)
def _updated(estimate: tuple[Array, Array], place: Array, innovations: tuple[Array, Array, Array], correlation: float) -> tuple[Array, Array]:
    """State (6,) and covariance (6, 6) after the innovations at `place` (k, 2) m from the centre."""
    x, P = estimate
    J = np.zeros((2, 6))
    J[0, 0] = J[1, 1] = 1.0
    for k in range(len(place)):
        residual, H, S = innovations[0][k], innovations[1][k], innovations[2][k]
        if np.isfinite(residual).all():
            J[0, 2:4] = J[1, 4:6] = place[k]
            full = H @ J
            # All residuals have the bias of the last tick subtracted already.
            K = np.linalg.solve(full @ P @ full.T + correlation * S, full @ P).T.copy()
            x, P = x + K @ residual, P - K @ full @ P
    return x, P
