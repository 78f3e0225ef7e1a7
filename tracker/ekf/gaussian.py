"""Gaussian estimation: gates, robust weights, gains, the covariance after an update, and NEES.

A measurement has m numbers and the state has n. `HP` stands for H @ P (m, n). The Jacobians of a map are sparse, so the caller forms that
product in the cheapest way and passes it in.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg.blas import dsyrk
from scipy.linalg.lapack import dposv, dpotrf, dtrtrs
from scipy.special import gammaincinv

from tracker.geometry import Array

TILE = 128
"""Rows and columns of a covariance that are mirrored at once: such a block fits into the processor's cache."""
UPPER = np.triu(np.ones((TILE, TILE), dtype=bool), 1)


@cache
def gate(dof: int, probability: float) -> float:
    """The bound on the squared Mahalanobis distance that a correct measurement of `dof` numbers satisfies with `probability` in (0, 1).

    Raises ValueError for `dof` below 1 or a probability outside (0, 1).
    """
    if dof < 1 or not 0 < probability < 1:
        raise ValueError(f"gate of {dof} numbers at probability {probability}, needs at least 1 and a probability in (0, 1)")
    # The quantile of χ². scipy.stats has it, too, and takes half a second to import.
    return float(2 * gammaincinv(dof / 2, probability))


def mahalanobis2(error: ArrayLike, covariance: ArrayLike) -> Array:
    """Errors (..., d) and covariances (..., d, d) → squared Mahalanobis distances (...)."""
    e = np.asarray(error, dtype=np.float64)
    return (e * np.linalg.solve(np.asarray(covariance, dtype=np.float64), e[..., None])[..., 0]).sum(axis=-1)


def nees(error: ArrayLike, covariance: ArrayLike) -> float:
    """The normalised estimation error squared of one estimate, divided by the degrees of freedom: 1 on average if the covariance is consistent.

    error (d,), covariance (d, d) (Bar-Shalom, Li, Kirubarajan 2001, 5.4.2).
    """
    return float(mahalanobis2(error, covariance)) / len(np.asarray(error))


def block_diagonal(blocks: Array) -> Array:
    """(k, d, d) → (k d, k d)."""
    k, d, _ = blocks.shape
    out = np.zeros((k, d, k, d))
    out[np.arange(k), :, np.arange(k), :] = blocks
    return out.reshape(k * d, k * d)


def robust_weights(HPH: Array, noise: Array, innovation: Array, threshold: float) -> Array:
    """Weights (k,) in (0, 1] of k measurements of d numbers each, found before the update by iteratively reweighted least squares.

    HPH (k d, k d) = H P Hᵀ, noise R (k, d, d), innovation ν (k d,). With S = HPH + R the residual after the update is R S⁻¹ ν.
    The iteration therefore needs no state. A residual of s standard deviations of its noise has weight 1 up to the threshold (Huber).
    Beyond it the weight is (threshold / s)², whose influence falls as that of Cauchy's loss. The noise is divided by the weight.
    An infinite threshold leaves all weights at 1.
    """
    k, d = len(noise), noise.shape[1]
    weights = np.ones(k)
    if not np.isfinite(threshold):
        return weights
    for _ in range(4):
        S = HPH + block_diagonal(noise / weights[:, None, None])
        force = solve_positive(S, innovation).reshape(k, d)
        after = np.einsum("kij,kj->ki", noise, force) / weights[:, None]
        size = np.sqrt(np.maximum((after * force).sum(axis=1) / weights, 0.0))
        weights = np.minimum(1.0, (threshold / np.maximum(size, 1e-12)) ** 2)
        weights = np.maximum(weights, 1e-6)
    return weights


def solve_positive(S: Array, right: Array) -> Array:
    """S⁻¹ right by Cholesky factors, for a positive definite S (m, m) and right (m,) or (m, n). Raises LinAlgError if S is not positive definite."""
    _, solution, info = dposv(S, right, lower=1)
    if info:
        raise np.linalg.LinAlgError(f"matrix of {len(S)} rows is not positive definite, or not finite")
    out: Array = solution
    return out


def whitened(HP: Array, S: Array) -> Array:
    """A = L⁻¹ H P (m, n) with S = L Lᵀ (m, m), the innovation covariance: the gain is Aᵀ L⁻¹, and P − Aᵀ A is the covariance after the update.

    Joseph's form for a gain K is this plus (A − LᵀKᵀ)ᵀ (A − LᵀKᵀ). For the optimal gain that term is the square of rounding errors.
    The form here is as stable, and needs one product of n² m where Joseph's needs two. Raises LinAlgError if S is not positive definite.
    """
    L, info = dpotrf(S, lower=1)
    if info or not np.isfinite(L).all():
        raise np.linalg.LinAlgError(f"matrix of {len(S)} rows is not positive definite, or not finite")
    out: Array = dtrtrs(L, HP, lower=1)[0]
    return out


def subtract(P: Array, A: Array) -> None:
    """P ← P − Aᵀ A in place; the result is exactly symmetric.

    P (n, n) C-contiguous and symmetric, A (m, n). Raises ValueError if P is not contiguous: BLAS would change a copy.
    """
    if not P.flags.c_contiguous:
        raise ValueError(f"covariance of shape {P.shape} is not contiguous, needs a contiguous array")
    # P.T is in Fortran order: its upper triangle is the lower one of P.
    dsyrk(-1.0, A.T, beta=1.0, c=P.T, overwrite_c=1)
    for at in range(0, len(P), TILE):
        rows = slice(at, at + TILE)
        for left in range(0, at, TILE):
            P[left : left + TILE, rows] = P[rows, left : left + TILE].T
        block = P[rows, rows]
        np.copyto(block, block.T, where=UPPER[: len(block), : len(block)])
