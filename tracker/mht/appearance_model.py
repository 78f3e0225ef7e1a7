"""Online appearance model of each track: log-likelihood ratios of boxes by their appearance (Kim et al. 2015; Yoo et al. 2017).

Colour histograms from images have a known distribution of distances. For cosines of a detector's own vectors it is learned online.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tracker.detections.ground_points import GroundDetections
from tracker.geometry import Array, Ints
from tracker.mht.track_trees import TrackHypotheses
from tracker.tracks.reidentification import Appearance

LOG_RATIO = np.array([[1.0, 4.0], [1.5, 2.8], [2.5, 1.0], [3.5, -0.8], [5.0, -2.5], [6.5, -3.5]])
"""Rows: distance of a box from a track's appearance, over the usual distance of a person's own boxes; log-likelihood ratio over another person.

Origin: PETS S2.L1, views 1 and 6, frames 0 to 399.
"""
PRIOR_DISTANCE, PRIOR_COUNT = 0.02, 50.0
"""Prior of the usual distance of a person's own boxes, and the number of boxes for which it counts."""
DISTANCE_BOUNDS = 0.004, 0.06
"""Bounds of the usual distance."""
MEMORY = 4000.0
"""Number of new pairs after which older pairs have faded to 1/e."""
WEAK = 40.0
"""Number of pairs of either kind at which the log-likelihood ratio has half its weight."""
LEAST_SIGMA = 0.01
"""Least standard deviation of the cosines of either kind: of the same person, of another person."""
MOST = 6.0
"""Greatest log-likelihood ratio, by absolute value."""
WEIGHT, RATE = 0.7, 0.1
"""Weight of the log-likelihood ratios, and learning rate of a track's appearance."""


class AppearanceModel:
    """Appearance is compared within one camera alone: colours and light differ from camera to camera."""

    def __init__(self, cameras: list[str]) -> None:
        self.column = {camera: k for k, camera in enumerate(cameras)}
        self._distance = np.full(len(cameras), PRIOR_DISTANCE * PRIOR_COUNT)
        self._counts = np.full(len(cameras), PRIOR_COUNT)
        self._given: dict[int, CosineModel] = {}  # of the cameras whose detector gives vectors

    def log_ratio(self, leaves: TrackHypotheses, views: list[GroundDetections]) -> Array:
        """Log-likelihood ratio (n, D) of the boxes of all views for each leaf, 0 where either appearance is unknown."""
        out = [np.zeros((len(leaves), len(boxes))) for boxes in views]
        for boxes, ratio in zip(views, out, strict=True):
            if boxes.appearance is None or not leaves.appearance.size:
                continue
            c = self.column[boxes.camera]
            known, seen = np.flatnonzero(leaves.appearance_count[:, c] > 0), np.flatnonzero(np.isfinite(boxes.appearance[:, 0]))
            length = min(boxes.appearance.shape[1], leaves.appearance.shape[2])
            cosine = _unit(leaves.appearance[known, c, :length]) @ boxes.appearance[seen, :length].T
            ratio[np.ix_(known, seen)] = WEIGHT * self._log_ratio(c, cosine)
        return np.concatenate([np.zeros((len(leaves), 0)), *out], axis=1)

    def _log_ratio(self, column: int, cosine: Array) -> Array:
        """Log-likelihood ratio of cosines of any shape in a camera."""
        if column in self._given:
            return self._given[column].log_ratio(cosine)
        usual = np.clip(self._distance[column] / self._counts[column], *DISTANCE_BOUNDS)
        return np.asarray(np.interp((1 - cosine) / usual, *LOG_RATIO.T))

    def same_person(self, a: Appearance, b: Appearance) -> float:
        """Log-likelihood ratio of two tracks being one person by the vectors that detectors gave: the mean over the cameras that saw both.

        It is 0 where no camera with such vectors saw both.
        """
        if not (a.mean.size and b.mean.size):
            return 0.0
        both = [c for c in self._given if a.boxes[c] > 0 and b.boxes[c] > 0]
        length = min(a.mean.shape[1], b.mean.shape[1])
        ratios = [self._given[c].log_ratio(_unit(a.mean[c : c + 1, :length]) @ _unit(b.mean[c : c + 1, :length]).T) for c in both]
        return WEIGHT * float(np.mean(ratios)) if ratios else 0.0

    def with_appearance(self, leaves: TrackHypotheses, views: list[GroundDetections], box: Ints, sure: NDArray[np.bool_]) -> TrackHypotheses:
        """The leaves with their appearance updated by their boxes; the models of distances and cosines learn from those that are `sure` (n,).

        box (n, V): rows of each view's boxes, −1 for none.
        """
        if all(boxes.appearance is None for boxes in views):
            return leaves
        length = max([leaves.appearance.shape[2], *(boxes.appearance.shape[1] for boxes in views if boxes.appearance is not None)])
        mean, count = np.zeros((len(leaves), len(self.column), length)), np.zeros((len(leaves), len(self.column)))
        # Padding a shorter vector with zeros changes no cosine.
        before = leaves.appearance.shape[1:]
        mean[:, : before[0], : before[1]], count[:, : before[0]] = leaves.appearance, leaves.appearance_count
        for v, boxes in enumerate(views):
            if boxes.appearance is None:
                continue
            c = self.column[boxes.camera]
            rows = np.flatnonzero(box[:, v] >= 0)
            rows = rows[np.isfinite(boxes.appearance[box[rows, v], 0])]
            now, part = boxes.appearance[box[rows, v]], slice(boxes.appearance.shape[1])
            old = sure[rows] & (count[rows, c] > 0)
            if boxes.appearance_given:
                model = self._given.setdefault(c, CosineModel())
                best = _best_of_trees(leaves, rows[old])
                model.learn(_unit(mean[rows[old][best], c, part]) @ now[old][best].T)
            else:
                distance = 1 - (_unit(mean[rows[old], c, part]) * now[old]).sum(axis=1)
                self._distance[c] += np.minimum(distance, LOG_RATIO[-1, 0] * PRIOR_DISTANCE).sum()
                self._counts[c] += len(distance)
            share = np.maximum(RATE, 1 / (count[rows, c] + 1))[:, None]
            mean[rows, c, part] += share * (now - mean[rows, c, part])
            count[rows, c] += 1
        return replace(leaves, appearance=mean, appearance_count=count)


class CosineModel:
    """Cosines of boxes with the mean vector of their own track, and with those of other tracks of the same view, as two normal distributions.

    Cosines beyond either mean are clipped to it, so that the ratio is monotone. The scale and length of vectors do not matter.
    """

    def __init__(self) -> None:
        self._moments = np.zeros((2, 3))  # rows: the same person, another one; columns: number, sum and sum of squares, faded

    def learn(self, cosine: Array) -> None:
        """Count the cosines (k, k) of k tracks, in rows, with the boxes that they have taken: those on the diagonal are of the same person."""
        same = np.eye(len(cosine), dtype=bool)
        for row, values in enumerate((cosine[same], cosine[~same])):
            now = np.array([len(values), values.sum(), (values**2).sum()])
            self._moments[row] = np.exp(-len(values) / MEMORY) * self._moments[row] + now

    def log_ratio(self, cosine: Array) -> Array:
        """Log-likelihood ratio of the same person over another one for cosines of any shape; 0 until enough pairs are known."""
        number = self._moments[:, :1]
        if number.min() < 2:
            return np.zeros(cosine.shape)
        (same, other), (square, square_other) = (self._moments[:, 1:] / number).T
        if same <= other:
            return np.zeros(cosine.shape)
        sigma, sigma_other = np.sqrt(np.maximum([square - same**2, square_other - other**2], LEAST_SIGMA**2))
        at = np.clip(cosine, other, same)
        ratio = 0.5 * (((at - other) / sigma_other) ** 2 - ((at - same) / sigma) ** 2) + np.log(sigma_other / sigma)
        least = float(number.min())
        return np.asarray(np.clip(ratio * least / (least + WEAK), -MOST, MOST))


def _best_of_trees(leaves: TrackHypotheses, rows: Ints) -> Ints:
    """Indices into `rows` of the leaf of each tree with the highest score."""
    order = np.lexsort((-leaves.score[rows], leaves.tree[rows]))
    return np.asarray(order[np.unique(leaves.tree[rows][order], return_index=True)[1]])


def _unit(appearance: Array) -> Array:
    return np.asarray(appearance / np.maximum(np.linalg.norm(appearance, axis=1, keepdims=True), 1e-12))
