"""Adaptive measurement noise: the variance of each view's boxes, estimated from innovations while tracking.

Squared innovations are compared with their predicted variance, along azimuth and elevation (adaptive filtering: Mehra 1972). A view that is worse
than assumed is inflated. No view goes below the assumed variance: tracks follow the errors of a view, so that its innovations look too small.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tracker.detections.ground_points import GroundDetections
from tracker.geometry import Array
from tracker.geometry.compilation import njit

BOUNDS = -10.0, 30.0
"""Bounds of the ratio of variances that one innovation gives."""

WEIGHT, MAX_RATIO = 30.0, 10.0
"""Number of innovations for which the assumed variance counts, and the greatest ratio to it."""


@dataclass(frozen=True)
class MeasurementNoiseParameters:
    """Weight of the estimate."""

    excess: float = 2.0  # factor of the estimated excess, as errors of boxes are correlated over time; 0 switches the estimation off


class MeasurementNoise:
    """Estimates of all cameras: the sum (2,) of the ratios of variances, and their number."""

    def __init__(self, parameters: MeasurementNoiseParameters) -> None:
        self.parameters = parameters
        self._sums: dict[str, tuple[Array, int]] = {}

    def of(self, camera: str) -> Array:
        """Ratios (2,) of the variance of boxes of `camera` to the assumed one, along azimuth and elevation."""
        q = self.parameters
        total, count = self._sums.get(camera, (np.zeros(2), 0))
        return np.asarray(np.clip(1 + q.excess * ((WEIGHT + total) / (WEIGHT + count) - 1), 1.0, MAX_RATIO))

    def inflated(self, feet: GroundDetections) -> GroundDetections:
        """The detections with covariances of directions inflated by the estimated ratios."""
        k = np.sqrt(self.of(feet.camera))
        return replace(feet, covariance=feet.covariance * np.outer(k, k))

    def learn(self, camera: str, residual: Array, S: Array, covariance: Array) -> None:
        """Update by innovations (k, 2) rad, NaN where there is none, of covariance S (k, 2, 2) rad².

        covariance (k, 2, 2) rad²: the part of S that is due to the boxes, as `inflated`.
        """
        seen = np.isfinite(residual).all(axis=1)
        total, count = self._sums.get(camera, (np.zeros(2), 0))
        self._sums[camera] = total + _sum_of_ratios(residual[seen], S[seen], covariance[seen], self.of(camera)), count + int(seen.sum())


@njit(cache=True)
def _sum_of_ratios(residual: Array, S: Array, covariance: Array, ratios: Array) -> Array:
    """Sum (2,) of the ratios of variances: residual² less the variance of the prediction, over the assumed variance of a box."""
    out = np.zeros(2)
    for k in range(len(residual)):
        for i in range(2):
            ratio = (residual[k, i] ** 2 - S[k, i, i] + covariance[k, i, i]) / (covariance[k, i, i] / ratios[i])
            out[i] += min(max(ratio, BOUNDS[0]), BOUNDS[1])
    return out
