"""Which estimate stands for which person in every frame (CLEAR-MOT's correspondences), and what is counted from that."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.optimize import linear_sum_assignment

from tracker.comparison import Comparison, Frame, Ints

# Rows and columns of each frame's matched pairs.
Matches = list[tuple[Ints, Ints]]

# A kept match outweighs every sum of similarities.
KEPT = 1000
EPSILON = float(np.finfo(np.float64).eps)
MOSTLY_TRACKED, MOSTLY_LOST = 0.8, 0.2


def correspond(comparison: Comparison, threshold: float) -> Matches:
    """Match every frame by TrackEval's rule; the values of `comparison` are similarities, a pair is valid from `threshold` on.

    A match of the frame before is kept while it is valid, the others maximise the sum of similarities. A frame with nobody on one side
    leaves the memory as it was.
    """
    previous = np.full(comparison.truths, -1)
    out: Matches = []
    for frame in comparison.frames:
        kept = frame.estimate[None, :] == previous[frame.truth][:, None]
        worth = np.where(frame.value < threshold - EPSILON, 0.0, KEPT * kept + frame.value)
        rows, columns = linear_sum_assignment(-worth)
        real = worth[rows, columns] > EPSILON
        rows, columns = rows[real], columns[real]
        out.append((rows, columns))
        if worth.size:
            previous[:] = -1
            previous[frame.truth[rows]] = frame.estimate[columns]
    return out


def without_ignored(frames: Sequence[Frame], comparison: Comparison, matches: Matches) -> Comparison:
    """Take out the people who do not count, together with the estimates that `matches` gives to them."""
    kept = []
    for frame, pairing, (rows, columns) in zip(frames, comparison.frames, matches, strict=True):
        counts = np.ones(len(pairing.truth), dtype=bool) if frame.counts is None else frame.counts
        stays = np.ones(len(pairing.estimate), dtype=bool)
        stays[columns[~counts[rows]]] = False
        kept.append(pairing.restricted(counts, stays))
    return Comparison(tuple(kept), comparison.truths, comparison.estimates)


def clear_counts(comparison: Comparison, matches: Matches) -> dict[str, int]:
    """The integers of CLEAR-MOT, by the names of TargetScore's fields."""
    last = np.full(comparison.truths, -1)
    tracked = np.zeros(comparison.truths, dtype=bool)
    begun, followed = np.zeros((2, comparison.truths), dtype=np.int64)
    switches = 0
    for frame, (rows, columns) in zip(comparison.frames, matches, strict=True):
        truth, estimate = frame.truth[rows], frame.estimate[columns]
        switches += int(((last[truth] >= 0) & (last[truth] != estimate)).sum())
        last[truth] = estimate
        followed[truth] += 1
        if frame.value.size:
            now = np.zeros_like(tracked)
            now[truth] = True
            begun += now & ~tracked
            tracked = now
    length, said = comparison.lengths()
    present = length > 0
    share = followed[present] / length[present]
    total = int(followed.sum())
    return {
        "matches": total,
        "false_positives": int(said.sum()) - total,
        "misses": int(length.sum()) - total,
        "switches": switches,
        "fragments": int(np.maximum(begun - 1, 0).sum()),
        "trajectories": int(present.sum()),
        "mostly_tracked": int((share > MOSTLY_TRACKED).sum()),
        "mostly_lost": int((share < MOSTLY_LOST).sum()),
    }


def matched_sum(comparison: Comparison, matches: Matches) -> float:
    """Σ of the values of the matched pairs."""
    return float(sum(frame.value[pair].sum() for frame, pair in zip(comparison.frames, matches, strict=True)))


def most_matches(comparison: Comparison, threshold: float) -> tuple[int, float]:
    """Without memory, as WILDTRACK has it: in each frame the most pairs with a value in [threshold, 1], and of those the greatest sum.

    Returns the number of pairs and their sum over all frames.
    """
    number, total = 0, 0.0
    for frame in comparison.frames:
        valid = frame.value >= threshold
        worth = np.where(valid, min(valid.shape) + 1 + frame.value, 0.0)
        rows, columns = linear_sum_assignment(-worth)
        real = valid[rows, columns]
        number += int(real.sum())
        total += float(frame.value[rows, columns][real].sum())
    return number, total
