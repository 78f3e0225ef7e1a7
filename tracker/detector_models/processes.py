"""Estimators of the processes of a detector model: logistic regression, a hidden Markov chain, and an AR(1) process with a lasting part.

Samples of a person in a view are a time series. Persistence is estimated from pairs of its frames at several lags
(pairwise likelihood, Lindsay 1988).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy.special import expit

from tracker.geometry import Array, Ints, Mask

LAGS = (1, 2, 3, 5, 8, 13, 21, 34, 55)
"""Frames from the first to the second of a pair."""
TIMES = tuple(np.geomspace(0.05, 60.0, 40).tolist())
"""s: time constants that are tried."""
FLICKERS = (0.0, 0.005, 0.01, 0.02, 0.03, 0.05, 0.08, 0.12, 0.2, 0.3)
"""Shares of misses without memory that are tried."""
STEPS = 50
"""Most steps of the logistic regression."""
BINS = 12
"""Bins of probabilities of a miss, with equal numbers of samples."""
Pairs = Sequence[tuple[float, Ints, Ints]]
"""Lag in s, and the rows of the first and of the second sample of each pair."""


def logistic(features: Array, outcome: Array, weight: Array, prior: float) -> Array:
    """Coefficients of a logistic regression (iteratively reweighted least squares), with a ridge on all but the first."""
    n = features.shape[1]
    ridge = prior * np.diag([1e-6, *np.ones(n - 1)])
    beta = np.zeros(n)
    for _ in range(STEPS):
        p = np.clip(expit(features @ beta), 1e-6, 1 - 1e-6)
        gradient = features.T @ (weight * (outcome - p)) - ridge @ beta
        step = np.linalg.solve((features * (weight * p * (1 - p))[:, None]).T @ features + ridge, gradient)
        beta = beta + np.clip(step, -5.0, 5.0)
        if np.abs(step).max() < 1e-6:
            break
    return np.asarray(np.clip(beta, -1e3, 1e3))


def pairs_of(view: Ints, person: Ints, frame: Ints, period: float) -> Pairs:
    """Pairs of samples of the same person in the same view at LAGS. Rows are ordered by view, person and frame."""
    out = []
    for lag in LAGS:
        # Frames are distinct within a series, so that the partner is at most `lag` rows ahead.
        found = [np.zeros((0, 2), dtype=np.int64)]
        for ahead in range(1, lag + 1):
            first = np.arange(len(view) - ahead)
            then = first + ahead
            same = (view[first] == view[then]) & (person[first] == person[then]) & (frame[then] - frame[first] == lag)
            found.append(np.column_stack([first, then])[same])
        both = np.concatenate(found)
        if len(both):
            out.append((lag * period, both[:, 0], both[:, 1]))
    return out


def hidden_chain(p: Array, event: Mask, pairs: Pairs, weight: Array, flickers: Sequence[float] = FLICKERS) -> tuple[float, float]:
    """Time constant, s, and flicker of the chain of model.Misses, for events of probability p (n,): the most likely pair of grid values.

    Given that the hidden uniform state stays, both events happen with the smaller of the two probabilities. Probabilities are taken in bins.
    """
    level, middle = _bins(p)
    times, total = np.array([0.0, *TIMES]), np.zeros((len(flickers), 1 + len(TIMES)))
    for lag, first, then in pairs:
        cells = _cells(level[first], level[then], event[first], event[then], weight[first], len(middle))
        stay = np.array([persistence(time_s, lag) for time_s in times])[:, None]
        for k, flicker in enumerate(flickers):
            total[k] += _likelihood(middle, cells, stay, flicker) / len(pairs)
    if not pairs or not event.any():
        return 0.0, 0.0
    flicker, time = divmod(int(np.argmax(total)), total.shape[1])
    return round(float(times[time]), 4), float(flickers[flicker])


def _bins(p: Array) -> tuple[Ints, Array]:
    """The bin (n,) of each probability, and the mean of each bin."""
    edges = np.unique(np.quantile(p, np.linspace(0, 1, BINS + 1)[1:-1]))
    level = np.searchsorted(edges, p)
    count = np.maximum(np.bincount(level, minlength=len(edges) + 1), 1)
    return level, np.bincount(level, p, len(edges) + 1) / count


def _cells(a: Ints, b: Ints, e1: Mask, e2: Mask, weight: Array, bins: int) -> Array:
    """Sums of weights (bins, bins, 2, 2) by the bins and the events of a pair."""
    index = ((a * bins + b) * 2 + e1) * 2 + e2
    return np.asarray(np.bincount(index, weight, bins * bins * 4).reshape(bins, bins, 2, 2))


def _likelihood(p: Array, cells: Array, stay: Array, flicker: float) -> Array:
    """Log likelihoods (t,) of the cells of a lag, for probabilities stay (t, 1) that the hidden state is the same."""
    q = np.clip((p - flicker) / (1 - flicker), 0.0, 1.0)
    a, b = (grid.ravel()[None] for grid in np.meshgrid(q, q, indexing="ij"))
    blind = stay * np.minimum(a, b) + (1 - stay) * a * b
    one, two = a + (1 - a) * flicker, b + (1 - b) * flicker
    both = blind + (a - blind) * flicker + (b - blind) * flicker + (1 - a - b + blind) * flicker**2
    table = np.stack([1 - one - two + both, two - both, one - both, both], axis=2)
    return np.asarray((cells.reshape(1, -1, 4) * np.log(np.maximum(table, 1e-9))).sum(axis=(1, 2)))


def lasting_and_drifting(score: Array, pairs: Pairs, weight: Array) -> tuple[float, float]:
    """Lasting share and time constant, s, of standard scores (n,), NaN where unknown: γ(lag) = lasting + (1 − lasting) exp(−lag / time_s).

    Autocovariances γ around 0, the mean of all people, are fitted by least squares, weighted by their numbers of pairs.
    """
    lags, gamma, number = [], [], []
    for lag, first, then in pairs:
        product, w = score[first] * score[then], weight[first]
        known = np.isfinite(product) & (w > 0)
        if known.sum() >= 10:
            lags.append(lag)
            gamma.append(float(np.average(product[known], weights=w[known])))
            number.append(float(w[known].sum()))
    if not lags:
        return 0.0, 0.0
    return lasting_share(np.clip(gamma, -1.0, 1.0), np.array(number), np.exp(-np.array(lags)[None] / np.array(TIMES)[:, None]))


def lasting_share(target: Array, weight: Array, decay: Array) -> tuple[float, float]:
    """Lasting share and time constant, s, of correlations target (n,): lasting + (1 − lasting) decay, by weighted least squares.

    decay (len(TIMES), n): the correlations of the drifting part, by time constant.
    """
    share = weight / np.sum(weight)
    # One unknown for each time constant: γ − decay = lasting (1 − decay).
    lasting = ((target - decay) * (1 - decay) * share).sum(axis=1) / np.maximum(((1 - decay) ** 2 * share).sum(axis=1), 1e-12)
    lasting = np.clip(lasting, 0.0, 1.0)
    loss = ((target - decay - lasting[:, None] * (1 - decay)) ** 2 * share).sum(axis=1)
    best = int(np.argmin(loss))
    return round(float(lasting[best]), 4), round(TIMES[best], 4)


def persistence(time_s: float, period: float) -> float:
    """Correlation from one frame to the next of a process of time constant time_s."""
    return math.exp(-period / time_s) if time_s > 0 else 0.0


def time_constant(rho: float, period: float) -> float:
    """Time constant, s, of a correlation rho in [0, 1) from one frame to the next; 0 for none."""
    return round(float(-period / np.log(rho)), 4) if rho > 1e-6 else 0.0
