"""HOTA (Luiten et al. 2020, "HOTA: a higher order metric for evaluating multi-object tracking"), as sums that can be merged over sequences."""

from __future__ import annotations

from dataclasses import dataclass, fields
from operator import add

import numpy as np
from scipy.optimize import linear_sum_assignment

from tracker.geometry import Array, Ints
from tracker.metrics.matching import Comparison

ALPHAS = np.arange(0.05, 0.99, 0.05)
ALPHAS.flags.writeable = False
EPSILON = float(np.finfo(np.float64).eps)


@dataclass(frozen=True)
class HotaSums:
    """For each of the 19 similarity thresholds α: true positives, misses, false positives, and Σ over true positives of A(c)."""

    matches: tuple[int, ...] = (0,) * len(ALPHAS)
    misses: tuple[int, ...] = (0,) * len(ALPHAS)
    false_positives: tuple[int, ...] = (0,) * len(ALPHAS)
    association: tuple[float, ...] = (0.0,) * len(ALPHAS)

    def __add__(self, other: HotaSums) -> HotaSums:
        return HotaSums(**{f.name: tuple(map(add, getattr(self, f.name), getattr(other, f.name))) for f in fields(self)})

    @property
    def deta(self) -> Array:
        """DetA_α = TP / (TP + FN + FP), (19,); NaN without truth and estimates."""
        everything = np.array(self.matches) + self.misses + self.false_positives
        return np.where(everything > 0, self.matches / np.maximum(1, everything), np.nan)

    @property
    def assa(self) -> Array:
        """AssA_α = mean over true positives of TPA / (TPA + FNA + FPA), (19,); 0 without true positives, as in TrackEval."""
        return np.asarray(np.array(self.association) / np.maximum(1, self.matches))

    @property
    def hota(self) -> float:
        """The mean over α of √(DetA · AssA); NaN without truth and estimates."""
        return float(np.sqrt(self.deta * self.assa).mean())


def hota_sums(comparison: Comparison) -> HotaSums:
    """Score one sequence; the values of `comparison` are similarities in [0, 1].

    The matching is TrackEval's. In each frame the Hungarian algorithm maximises the similarity, weighted by the agreement of the two
    trajectories over the sequence (the paper's equation 14 with soft counts). It is computed once and thresholded at every α.
    """
    truth_length, estimate_length = comparison.lengths()
    weight = _alignment(comparison, truth_length, estimate_length)
    none = np.zeros(0, dtype=np.int64)
    truths, estimates, similarities = [none], [none], [np.zeros(0)]
    for frame in comparison.frames:
        rows, columns = linear_sum_assignment(-weight[np.ix_(frame.truth, frame.estimate)] * frame.value)
        truths.append(frame.truth[rows])
        estimates.append(frame.estimate[columns])
        similarities.append(frame.value[rows, columns])
    truth, estimate, similarity = np.concatenate(truths), np.concatenate(estimates), np.concatenate(similarities)
    matches, association = [], []
    for alpha in ALPHAS:
        kept = similarity >= alpha - EPSILON
        pairs, together = np.unique(truth[kept] * comparison.estimates + estimate[kept], return_counts=True)
        i, j = np.divmod(pairs, max(1, comparison.estimates))
        association.append(float((together * (together / (truth_length[i] + estimate_length[j] - together))).sum()))
        matches.append(int(kept.sum()))
    misses, false_positives = (tuple(int(length.sum()) - m for m in matches) for length in (truth_length, estimate_length))
    return HotaSums(tuple(matches), misses, false_positives, tuple(association))


def _alignment(comparison: Comparison, truth_length: Ints, estimate_length: Ints) -> Array:
    """The soft Jaccard index of every truth and estimate trajectory, (truths, estimates)."""
    potential = np.zeros((comparison.truths, comparison.estimates))
    for frame in comparison.frames:
        s = frame.value
        union = s.sum(axis=0)[None, :] + s.sum(axis=1)[:, None] - s
        potential[np.ix_(frame.truth, frame.estimate)] += np.where(union > EPSILON, s / np.where(union > EPSILON, union, 1.0), 0.0)
    whole = truth_length[:, None] + estimate_length[None, :] - potential
    return np.asarray(potential / np.where(whole > 0, whole, 1.0))
