"""What the cosine of two appearance vectors of a detector says of whether they are of one person, learned while tracking."""

from __future__ import annotations

import numpy as np

from tracker.geometry import Array

MEMORY = 4000.0
"""Pairs with which older ones fade."""
WEAK = 40.0
"""Pairs of each kind for which "it says nothing" counts."""
LEAST_SIGMA = 0.01
"""Least standard deviation of the cosines of a kind."""
MOST = 6.0
"""Greatest log-likelihood ratio, by absolute value."""


class CosineModel:
    """Cosines of boxes with the mean vector of their own track, and with those of other tracks of the same view, as two normal distributions.

    A cosine beyond the mean of a kind says as much as the mean, so that the ratio is monotone. The scale and length of vectors do not matter.
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
