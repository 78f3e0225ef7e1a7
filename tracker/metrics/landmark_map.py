"""Scores of maps: how near landmarks are to true ones, how many of those that were to be had are there, and how many are nowhere."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from scipy.optimize import linear_sum_assignment

from tracker.geometry import Array, Mask, Pose

NEAR = 0.5
"""m between a landmark and the true one that it can stand for: what is farther off is a ghost and not an error."""


@dataclass(frozen=True)
class MapScore:
    """Sums over maps; `+` merges them and MapScore() is neutral. landmarks: estimated ones; matched: those with a true one; raw, aligned: Σ of
    their squared errors, m²; wanted: true landmarks that should be there; found: those of them that are.
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
        """map_m, map_aligned_m: RMSE of the landmarks that stand for a true one, as they are and after the team's alignment; map_complete: the
        share of wanted ones that are found; map_ghosts: the share of landmarks that stand for none, or for one that has a nearer one already.
        """
        matched, wanted, all_ = self.matched, self.wanted, self.landmarks
        return {
            "map_m": float(np.sqrt(self.raw / matched)) if matched else None,
            "map_aligned_m": float(np.sqrt(self.aligned / matched)) if matched else None,
            "map_complete": self.found / wanted if wanted else None,
            "map_ghosts": 1 - matched / all_ if all_ else None,
        }


def score_map(truth: Array, landmarks: Array, wanted: Mask, alignment: Pose | None = None) -> MapScore:
    """True landmarks (n, 3) m, of which `wanted` (n,) were seen well enough to be in a map, and estimated ones (m, 3) m, without names.

    alignment: of the team with its truth (trajectory.align): map and robots are moved as one. Each estimate stands for the nearest true landmark
    within NEAR after it, one for one, with the least sum of squares.
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
