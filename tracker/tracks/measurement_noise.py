"""How noisy each view's feet are, learned while tracking: boxes of one detector lie better than those of another, and silhouettes seen from low down
lie worse than either.

What feet differ from where they are expected is compared with what that should be, across and up and down. A view that is worse than assumed
counts for less from then on. None counts for more: a track that has followed a view's own errors finds that view better than it is.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numba import njit

from tracker.detections.ground_points import GroundDetections
from tracker.geometry import Array

BOUNDS = -10.0, 30.0
"""Within which one look says how noisy a view is, in variances of what is assumed."""


@dataclass(frozen=True)
class MeasurementNoiseParameters:
    """How fast and how far what is assumed of boxes is given up."""

    weight: float = 30.0  # looks that what is assumed counts for
    excess: float = 2.0  # times that counts what is beyond what is assumed: boxes err in runs, and are no new look each; 0 switches learning off
    most: float = 10.0  # times the assumed variance


class MeasurementNoise:
    """Of each camera the sum (2,) of what looks said, and their number."""

    def __init__(self, parameters: MeasurementNoiseParameters) -> None:
        self.parameters = parameters
        self._said: dict[str, tuple[Array, int]] = {}

    def of(self, camera: str) -> Array:
        """Times (2,) the assumed variance that feet of `camera` have along azimuth and along elevation."""
        q = self.parameters
        said, looks = self._said.get(camera, (np.zeros(2), 0))
        return np.asarray(np.clip(1 + q.excess * ((q.weight + said) / (q.weight + looks) - 1), 1.0, q.most))

    def widened(self, feet: GroundDetections) -> GroundDetections:
        """Boxes whose lines of sight are as sure as is known of their view."""
        k = np.sqrt(self.of(feet.camera))
        return replace(feet, covariance=feet.covariance * np.outer(k, k))

    def learn(self, camera: str, residual: Array, S: Array, covariance: Array) -> None:
        """Take innovations (k, 2) rad, NaN where there is none, and their covariance S (k, 2, 2) rad²; covariance (k, 2, 2) rad²: what boxes, as they
        were `widened`, have in that."""
        seen = np.isfinite(residual).all(axis=1)
        said, looks = self._said.get(camera, (np.zeros(2), 0))
        self._said[camera] = said + _said(residual[seen], S[seen], covariance[seen], self.of(camera)), looks + int(seen.sum())


@njit(cache=True)
def _said(residual: Array, S: Array, covariance: Array, times: Array) -> Array:
    """Sum (2,) of what looks say: the share of residual² beyond what comes of the person, over the variance that is assumed of boxes."""
    out = np.zeros(2)
    for k in range(len(residual)):
        for i in range(2):
            ratio = (residual[k, i] ** 2 - S[k, i, i] + covariance[k, i, i]) / (covariance[k, i, i] / times[i])
            out[i] += min(max(ratio, BOUNDS[0]), BOUNDS[1])
    return out
