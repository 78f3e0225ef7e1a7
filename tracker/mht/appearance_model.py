"""Online appearance model of each track: log-likelihood ratios of boxes by their appearance in images (Kim et al. 2015; Yoo et al. 2017)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tracker.detections.appearance import SIZE
from tracker.detections.ground_points import GroundDetections
from tracker.geometry import Array, Ints
from tracker.mht.track_trees import TrackHypotheses

LOG_RATIO = np.array([[1.0, 4.0], [1.5, 2.8], [2.5, 1.0], [3.5, -0.8], [5.0, -2.5], [6.5, -3.5]])
"""Distance of a box from a track's appearance over the usual distance of a person's own boxes, and the log-likelihood ratio over another person.

Origin: PETS S2.L1, views 1 and 6, frames 0 to 399.
"""
PRIOR_DISTANCE, PRIOR_COUNT = 0.02, 50.0
"""Usual distance of a person's own boxes at first, and the number of boxes that this counts for."""
DISTANCE_BOUNDS = 0.004, 0.06
"""Bounds of the usual distance."""


class AppearanceModel:
    """Appearance is compared within one camera alone: colours and light differ from camera to camera."""

    def __init__(self, weight: float, rate: float, cameras: list[str]) -> None:
        """weight: of the log-likelihood ratios; rate: learning rate of a track's appearance."""
        self.weight, self.rate, self.column = weight, rate, {camera: k for k, camera in enumerate(cameras)}
        self._distance = np.full(len(cameras), PRIOR_DISTANCE * PRIOR_COUNT)
        self._counts = np.full(len(cameras), PRIOR_COUNT)

    def log_ratio(self, leaves: TrackHypotheses, views: list[GroundDetections]) -> Array:
        """Log-likelihood ratio (n, D) of the boxes of all views for each leaf, 0 where either appearance is unknown."""
        out = [np.zeros((len(leaves), len(boxes))) for boxes in views]
        for boxes, ratio in zip(views, out, strict=True):
            if boxes.appearance is None or not leaves.appearance.size:
                continue
            c = self.column[boxes.camera]
            known, seen = np.flatnonzero(leaves.appearance_count[:, c] > 0), np.flatnonzero(np.isfinite(boxes.appearance[:, 0]))
            distance = 1 - _unit(leaves.appearance[known, c]) @ boxes.appearance[seen].T
            usual = np.clip(self._distance[c] / self._counts[c], *DISTANCE_BOUNDS)
            ratio[np.ix_(known, seen)] = self.weight * np.interp(distance / usual, *LOG_RATIO.T)
        return np.concatenate([np.zeros((len(leaves), 0)), *out], axis=1)

    def with_appearance(self, leaves: TrackHypotheses, views: list[GroundDetections], box: Ints, sure: NDArray[np.bool_]) -> TrackHypotheses:
        """The leaves with their appearance updated by their boxes; the usual distance is learned from those that are `sure` (n,).

        box (n, V): rows of each view's boxes, −1 for none.
        """
        if all(boxes.appearance is None for boxes in views):
            return leaves
        shape = len(leaves), len(self.column), SIZE
        mean, count = np.zeros(shape), np.zeros(shape[:2])
        if leaves.appearance.size:
            mean, count = leaves.appearance.copy(), leaves.appearance_count.copy()
        for v, boxes in enumerate(views):
            if boxes.appearance is None:
                continue
            c = self.column[boxes.camera]
            rows = np.flatnonzero(box[:, v] >= 0)
            rows = rows[np.isfinite(boxes.appearance[box[rows, v], 0])]
            now = boxes.appearance[box[rows, v]]
            old = sure[rows] & (count[rows, c] > 0)
            distance = 1 - (_unit(mean[rows[old], c]) * now[old]).sum(axis=1)
            self._distance[c] += np.minimum(distance, LOG_RATIO[-1, 0] * PRIOR_DISTANCE).sum()
            self._counts[c] += len(distance)
            share = np.maximum(self.rate, 1 / (count[rows, c] + 1))[:, None]
            mean[rows, c] += share * (now - mean[rows, c])
            count[rows, c] += 1
        return replace(leaves, appearance=mean, appearance_count=count)


def _unit(appearance: Array) -> Array:
    return np.asarray(appearance / np.maximum(np.linalg.norm(appearance, axis=1, keepdims=True), 1e-12))
