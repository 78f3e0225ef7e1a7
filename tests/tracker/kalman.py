"""The standard Kalman update, a reference for the updates of the filters."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from tracker.ekf.gaussian import solve_positive, subtract, whitened
from tracker.geometry import Array


def condition(P: ArrayLike, H: ArrayLike, residual: ArrayLike, R: ArrayLike) -> tuple[Array, Array]:
    """One Kalman update of a small dense state: the change of the mean (n,) and the updated covariance (n, n)."""
    P, H = np.array(P, dtype=np.float64), np.asarray(H, dtype=np.float64)
    HP = H @ P
    S = HP @ H.T + np.asarray(R, dtype=np.float64)
    change = HP.T @ solve_positive(S, np.asarray(residual, dtype=np.float64))
    subtract(P, whitened(HP, S))
    return change, P
