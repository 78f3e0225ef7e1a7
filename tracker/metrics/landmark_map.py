"""Scores of landmark maps: accuracy, completeness, and false landmarks."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from scipy.optimize import linear_sum_assignment

from tracker.geometry import Array, Mask, Pose

NEAR = 0.5
"""m: the largest distance between a landmark and its true one; a landmark farther from all true ones is false (a ghost)."""


@dataclass(frozen=True)
class MapScore:
    """Sums over maps; `+` merges them and MapScore() is neutral.

    landmarks: estimated ones; matched: those with a true one; raw, aligned: Σ of their squared errors, m². wanted: true landmarks that the map
    should contain; found: those of them that it contains.
    """

    landmarks: int = 0
    matched: int = 0
    raw: float = 0.0
    aligned: float = 0.0
    wanted: int = 0
    found: int = 0

    def __add__(self, other: MapScore) -> MapScore:
        return MapScore(**{f.name: getattr(self, f.name) + getattr(other, f.name) for f in fields(self)})

    def to_dict(self) -> dict[str, float | None]:
        """JSON values.

        map_m, map_aligned_m: RMSE of the matched landmarks, as they are and after the team's alignment. map_complete: the share of wanted
        landmarks that are found. map_ghosts: the share of landmarks without a true one of their own.
        """
        matched, wanted, all_ = self.matched, self.wanted, self.landmarks
        return {
            "map_m": float(np.sqrt(self.raw / matched)) if matched else None,
            "map_aligned_m": float(np.sqrt(self.aligned / matched)) if matched else None,
            "map_complete": self.found / wanted if wanted else None,
            "map_ghosts": 1 - matched / all_ if all_ else None,
        }


def score_map(truth: Array, landmarks: Array, wanted: Mask, alignment: Pose | None = None) -> MapScore:
    """Score estimated landmarks (m, 3) m without names against true ones (n, 3) m, of which `wanted` (n,) were seen well enough for a map.

    alignment: of the team with its truth (trajectory.align), applied to the map. The matching is one to one, within NEAR after the
    alignment, with the least sum of squares.
    """
    if not len(landmarks) or not len(truth):
        return MapScore(landmarks=len(landmarks), wanted=int(wanted.sum()))
    moved = (alignment or Pose.identity()).apply(landmarks)
    square = ((truth[:, None] - moved) ** 2).sum(axis=2)
    rows, columns = linear_sum_assignment(np.minimum(square, NEAR**2))
    good = square[rows, columns] < NEAR**2
    rows, columns = rows[good], columns[good]
    raw = float(((truth[rows] - landmarks[columns]) ** 2).sum())
    return MapScore(len(landmarks), len(rows), raw, float(square[rows, columns].sum()), int(wanted.sum()), int(wanted[rows].sum()))
