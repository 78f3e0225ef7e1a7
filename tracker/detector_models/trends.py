"""Errors of edges of one view that depend on the place, size and visible share of a body: a ridge regression.

Errors of calibration, lean and size of a body cause them. They change as a person walks, so they are neither constant nor noise.
"""

from __future__ import annotations

import numpy as np

from tracker.detector_models.schema import Table
from tracker.geometry import Array, Ints, Mask

TREND = ("across", "down", "across²", "down²", "across · down", "size", "hidden")
"""Features: place of the box from the middle over the size of the image, log2 of body over image height, and hidden share."""
RIDGES = (1.0, 0.1, 0.01, 0.001)
"""Ridge strengths that are tried, per row, for standardized features. Frames of a person are correlated, so strong ones are needed."""
FOLDS = 5
LEAST_GAIN = 0.02
"""Least reduction of the squared error, out of sample, for a regression to be used, as a share."""
EXTREME = 3.0
"""Errors are clipped to this number of standard deviations from the median."""


def trend_features(place: Array, size: Array, visible: Array, bounds: Array) -> Array:
    """Features (n, 7) in the order of TREND, each within its bounds (2, 7). place (n, 2), size (n,), visible (n,) as in PeopleSamples."""
    u, v = (np.asarray(place) - 0.5).T
    raw = np.column_stack([u, v, u**2, v**2, u * v, size, 1.0 - visible])
    return np.asarray(np.clip(raw, bounds[0], bounds[1]))


def bounds_of(features: Array) -> Array:
    """Bounds (2, k) of features (n, k): percentiles 2 and 98, beyond which nothing is extrapolated."""
    low, high = np.percentile(features, [2, 98], axis=0)
    return np.asarray(np.round(np.stack([low, high]), 5))


def folds_of(person: Ints, frame: Ints) -> Ints:
    """The fold (n,) of each row: people in turn where there are at least 3, and blocks of time otherwise."""
    names, number = np.unique(person, return_inverse=True)
    if len(names) >= 3:
        return np.asarray(number % min(FOLDS, len(names)))
    rank = np.searchsorted(np.unique(frame), frame)
    return np.asarray(rank * FOLDS // (rank.max() + 1) if len(rank) else rank)


def ridge(features: Array, value: Array, strength: float) -> tuple[Array, float]:
    """Coefficients (k,) and constant of a regression; strength over the number of rows, of standardized features."""
    mean, scale = features.mean(axis=0), np.maximum(features.std(axis=0), 1e-6)
    x, y = (features - mean) / scale, value - value.mean()
    beta = np.linalg.solve(x.T @ x + strength * len(x) * np.eye(x.shape[1]), x.T @ y) / scale
    return np.asarray(beta), float(value.mean() - mean @ beta)


def fitted_trend(features: Array, value: Array, folds: Ints) -> Array:
    """Coefficients (k,) of the strength that predicts rows of other folds best; zeros where none is better than the mean by LEAST_GAIN.

    value (n,): NaN where unknown.
    """
    known: Mask = np.isfinite(value)
    x, fold = features[known], folds[known]
    middle, spread = np.median(value[known]), np.std(value[known])
    y = np.clip(value[known], middle - EXTREME * spread, middle + EXTREME * spread)
    losses = [_loss(x, y, fold, strength) for strength in (np.inf, *RIDGES)]
    best = int(np.argmin(losses))
    if best == 0 or losses[best] > (1 - LEAST_GAIN) * losses[0]:
        return np.zeros(features.shape[1])
    return ridge(x, y, RIDGES[best - 1])[0]


def _loss(x: Array, y: Array, fold: Ints, strength: float) -> float:
    """Squared error out of sample; an infinite strength is the mean of the other folds."""
    total = 0.0
    for each in np.unique(fold).tolist():
        rest, mine = fold != each, fold == each
        if rest.sum() < 2 * x.shape[1]:
            return float("inf") if np.isfinite(strength) else float(((y - y.mean()) ** 2).sum())
        beta, constant = ridge(x[rest], y[rest], strength) if np.isfinite(strength) else (np.zeros(x.shape[1]), float(y[rest].mean()))
        total += float(((y[mine] - constant - x[mine] @ beta) ** 2).sum())
    return total


def fit_trend(place: tuple[Array, Array, Array], error: Array, folds: Ints) -> tuple[Table, Table]:
    """Coefficients (4, 7) and bounds (2, 7) of the features, as a model holds them, of errors (n, 4) of the terms; both () for no regression.

    place: as trend_features takes place, size and visible share.
    """
    bounds = bounds_of(trend_features(*place, np.array([[-np.inf], [np.inf]])))
    features = trend_features(*place, bounds)
    rows = [fitted_trend(features, error[:, k], folds) for k in range(error.shape[1])]
    if not any(np.any(row) for row in rows):
        return (), ()
    return tuple(tuple(np.round(row, 5).tolist()) for row in rows), tuple(map(tuple, bounds.tolist()))
