"""What the confidences of a detector say in a view, learned while tracking, whatever their scale.

The odds of a box to be of a person grow with its confidence. They are the isotonic regression of the last boxes, each counted as of a person or
false (pool adjacent violators: Barlow et al. 1972, Statistical inference under order restrictions). Only the order of confidences is used. So any
increasing transform of all of them gives the same odds.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import isotonic_regression

from tracker.geometry import Array

RANKS = 8
"""Number of ranks at which prior odds are given."""
REMEMBERED = 1500
"""Boxes of a view that are remembered, at most."""
PRIOR_RANKS = 20
"""Boxes that a rank in the middle counts for, while few boxes were seen."""
LEAST = 1e-3
"""Least count of either kind in a pool, which keeps odds finite."""


class ConfidenceCalibration:
    """The boxes of one view. `memory`: ticks, time constant with which they fade."""

    def __init__(self, memory: float) -> None:
        self._fade = np.exp(-1 / memory)
        self._seen = np.zeros(0)  # confidences of the last boxes, the latest last
        self._ranked = self._seen  # the same, sorted
        self._confidence, self._found, self._false = np.zeros(0), np.zeros(0), np.zeros(0)  # of boxes that were judged, sorted by confidence
        self._age = np.zeros(0)

    def observe(self, confidence: Array) -> None:
        """Remember the confidences (n,) of a tick, among which boxes are ranked."""
        self._seen = np.concatenate([self._seen, confidence])[-REMEMBERED:]
        self._ranked = np.sort(self._seen)

    def learn(self, found: Array, false: Array, weight: Array) -> None:
        """Count the boxes of a tick: confidences of people's boxes (f,) and of others (n,), which are false with probability `weight` (n,)."""
        new = np.concatenate([found, false])
        keep = np.argsort(self._age, kind="stable")[: REMEMBERED - min(len(new), REMEMBERED)]
        confidence = np.concatenate([self._confidence[keep], new])
        order = np.argsort(confidence, kind="stable")
        self._confidence = confidence[order]
        self._found = np.concatenate([self._fade * self._found[keep], np.ones(len(found)), np.zeros(len(false))])[order]
        self._false = np.concatenate([self._fade * self._false[keep], np.zeros(len(found)), weight])[order]
        self._age = np.concatenate([self._age[keep] + 1, np.zeros(len(new))])[order]

    def odds(self, confidence: Array, found: Array, false: Array) -> Array:
        """Odds (n,) that boxes of such confidence (n,) are of people. found, false (RANKS,): prior counts, from the lowest to the highest rank."""
        if not len(confidence):
            return np.zeros(0)
        ranked = self._ranked
        # A prior count lies at a quantile of the boxes seen, drawn to the middle of the ranks where few were.
        rank = (np.arange(RANKS) + 0.5) / RANKS
        n = len(ranked)
        at = np.clip(np.round(rank * (n + PRIOR_RANKS) - PRIOR_RANKS / 2), -1, n).astype(np.int64)
        inside = (at >= 0) & (at < n)
        where = np.where(inside, ranked[np.clip(at, 0, n - 1)], np.where(at < 0, -np.inf, np.inf))
        values = np.concatenate([self._confidence, where])
        order = np.argsort(values, kind="stable")
        values, first = np.unique(values[order], return_index=True)
        good = np.add.reduceat(np.concatenate([self._found, found])[order], first)
        bad = np.add.reduceat(np.concatenate([self._false, false])[order], first)
        fitted = _isotonic(good, bad)
        # Between two values the mean of their logarithms holds.
        below = np.clip(np.searchsorted(values, confidence, side="right") - 1, 0, None)
        above = np.clip(np.searchsorted(values, confidence, side="left"), None, len(values) - 1)
        return np.asarray(np.sqrt(fitted[below] * fitted[above]))


def _isotonic(good: Array, bad: Array) -> Array:
    """Odds (k,) of good over bad counts that do not fall; neighbours that would are pooled."""
    total = np.maximum(good + bad, LEAST**2)
    first = isotonic_regression(good / total, weights=total).blocks[:-1]
    odds = (np.add.reduceat(good, first) + LEAST) / (np.add.reduceat(bad, first) + LEAST)
    return np.asarray(np.repeat(odds, np.diff(np.append(first, len(good)))))
