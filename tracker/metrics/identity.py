"""Identity scores (Ristani et al. 2016, "Performance measures and a data set for multi-target, multi-camera tracking", sec. 3)."""

from __future__ import annotations

import numpy as np
from scipy.optimize import linear_sum_assignment

from tracker.metrics.matching import Comparison


def identity_counts(comparison: Comparison, threshold: float) -> tuple[int, int, int]:
    """IDTP, IDFP, IDFN: true positives, false positives and misses under the best one-to-one assignment of whole trajectories.

    The values of `comparison` are similarities; a pair agrees in a frame where its similarity is at least `threshold`. The assignment maximises
    the frames of agreement, which is the same as Ristani's least IDFP + IDFN. An unassigned pair adds its two lengths, and an assigned one
    its two lengths less twice the agreement.
    """
    agreement = np.zeros((comparison.truths, comparison.estimates))
    for frame in comparison.frames:
        rows, columns = np.nonzero(frame.value >= threshold)
        agreement[frame.truth[rows], frame.estimate[columns]] += 1
    rows, columns = linear_sum_assignment(-agreement)
    right = int(agreement[rows, columns].sum())
    truth, estimate = comparison.lengths()
    return right, int(estimate.sum()) - right, int(truth.sum()) - right
