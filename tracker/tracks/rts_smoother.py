"""One backward step of the fixed-interval smoother of Rauch, Tung, Striebel (1965), Maximum likelihood estimates of linear dynamic systems."""

from __future__ import annotations

import numpy as np

from tracker.geometry import Array

Gaussians = tuple[Array, Array]
"""Means (n, d) and covariances (n, d, d) of n states."""


def rts_step(now: Gaussians, after: Gaussians, F: Array, Q: Array) -> Gaussians:
    """The smoothed states of a time.

    now: its filtered states; after: the smoothed states one step later; F (n, d, d), Q (d, d): transition and process noise between them.
    """
    (x, P), (smoothed, covariance) = now, after
    predicted = F @ P @ F.transpose(0, 2, 1) + Q
    C = np.linalg.solve(predicted, F @ P).transpose(0, 2, 1)
    mean = x + (C @ (smoothed[:, :, None] - F @ x[:, :, None]))[:, :, 0]
    return mean, P + C @ (covariance - predicted) @ C.transpose(0, 2, 1)
