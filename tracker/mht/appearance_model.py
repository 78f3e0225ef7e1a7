"""Whose box it is by what people look like: what images say of boxes is said of the leaves of track trees."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tracker.detections.appearance import SIZE
from tracker.detections.ground_points import GroundDetections
from tracker.geometry import Array, Ints
from tracker.mht.track_trees import TrackHypotheses

ALIKE = np.array([[1.0, 4.0], [1.5, 2.8], [2.5, 1.0], [3.5, -0.8], [5.0, -2.5], [6.5, -3.5]])
"""How unlike a box is to what somebody looked like, over how unlike people are to themselves; and the log-likelihood ratio of being that one over
being another who is there (PETS S2.L1, views 1 and 6, frames 0 to 399)."""
USUAL, FIRST = 0.02, 50.0
"""How unlike people are to themselves at first, as if it had been seen so often."""
RANGE = 0.004, 0.06
"""Within which that is believed."""


class AppearanceModel:
    """Looks of one camera are compared with looks of that camera alone: colours and light differ from camera to camera."""

    def __init__(self, weight: float, fashion: float, cameras: list[str]) -> None:
        """weight: of what looks say; fashion: share by which somebody's look is renewed by a box."""
        self.weight, self.fashion, self.column = weight, fashion, {camera: k for k, camera in enumerate(cameras)}
        self._unlike = np.full(len(cameras), USUAL * FIRST)
        self._counts = np.full(len(cameras), FIRST)

    def worth(self, leaves: TrackHypotheses, views: list[GroundDetections]) -> Array:
        """log-likelihood ratio (n, D) of all boxes being of these leaves by what they look like, 0 where that is not known."""
        out = [np.zeros((len(leaves), len(feet))) for feet in views]
        for feet, worth in zip(views, out, strict=True):
            if feet.appearance is None or not leaves.appearance.size:
                continue
            c = self.column[feet.camera]
            known, seen = np.flatnonzero(leaves.worn[:, c] > 0), np.flatnonzero(np.isfinite(feet.appearance[:, 0]))
            unlike = 1 - _unit(leaves.appearance[known, c]) @ feet.appearance[seen].T
            typical = np.clip(self._unlike[c] / self._counts[c], *RANGE)
            worth[np.ix_(known, seen)] = self.weight * np.interp(unlike / typical, *ALIKE.T)
        return np.concatenate([np.zeros((len(leaves), 0)), *out], axis=1)

    def dressed(self, leaves: TrackHypotheses, views: list[GroundDetections], box: Ints, sure: NDArray[np.bool_]) -> TrackHypotheses:
        """The leaves with what their boxes (n, V; in each view's own rows, −1 for none) look like; of those who are `sure` (n,) it is learned how
        unlike people are to themselves."""
        if all(feet.appearance is None for feet in views):
            return leaves
        shape = len(leaves), len(self.column), SIZE
        look, worn = (leaves.appearance.copy(), leaves.worn.copy()) if leaves.appearance.size else (np.zeros(shape), np.zeros(shape[:2]))
        for v, feet in enumerate(views):
            if feet.appearance is None:
                continue
            c = self.column[feet.camera]
            rows = np.flatnonzero(box[:, v] >= 0)
            rows = rows[np.isfinite(feet.appearance[box[rows, v], 0])]
            now = feet.appearance[box[rows, v]]
            old = sure[rows] & (worn[rows, c] > 0)
            unlike = 1 - (_unit(look[rows[old], c]) * now[old]).sum(axis=1)
            self._unlike[c] += np.minimum(unlike, ALIKE[-1, 0] * USUAL).sum()
            self._counts[c] += len(unlike)
            share = np.maximum(self.fashion, 1 / (worn[rows, c] + 1))[:, None]
            look[rows, c] += share * (now - look[rows, c])
            worn[rows, c] += 1
        return replace(leaves, appearance=look, worn=worn)


def _unit(looks: Array) -> Array:
    return np.asarray(looks / np.maximum(np.linalg.norm(looks, axis=1, keepdims=True), 1e-12))
