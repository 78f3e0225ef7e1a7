"""Scores of landmark maps: accuracy, completeness, and false landmarks."""

from __future__ import annotations

import numpy as np
from scipy.optimize import linear_sum_assignment

from tracker.geometry import Array, Mask, Pose

NEAR = 0.5
"""m: the largest distance between a landmark and its true one; a landmark farther from all true ones is false (a ghost)."""


MEASURES = ("map_m", "map_aligned_m", "map_complete", "map_ghosts")


def score_map(truth: Array, landmarks: Array, wanted: Mask, alignment: Pose | None = None) -> dict[str, float | None]:
    """Score estimated landmarks (m, 3) m without names against true ones (n, 3) m, of which `wanted` (n,) were seen well enough for a map.

    alignment: of the team with its truth (trajectory.align), applied to the map. The matching is one to one, within NEAR after the
    alignment, with the least sum of squares. Returns MEASURES, None where undefined.

    map_m, map_aligned_m: RMSE of the matched landmarks, as they are and after the team's alignment. map_complete: the share of wanted
    landmarks that are found. map_ghosts: the share of landmarks without a true one of their own.
    """
    moved = (alignment or Pose.identity()).apply(landmarks)
    square = ((truth[:, None] - moved) ** 2).sum(axis=2)
    rows, columns = linear_sum_assignment(np.minimum(square, NEAR**2))
    good = square[rows, columns] < NEAR**2
    rows, columns = rows[good], columns[good]
    raw, matched = ((truth[rows] - landmarks[columns]) ** 2).sum(), len(rows)
    values = (
        float(np.sqrt(raw / matched)) if matched else None,
        float(np.sqrt(square[rows, columns].sum() / matched)) if matched else None,
        float(wanted[rows].sum() / wanted.sum()) if wanted.any() else None,
        1 - matched / len(landmarks) if len(landmarks) else None,
    )
    return dict(zip(MEASURES, values, strict=True))
