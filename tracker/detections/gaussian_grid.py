"""Normal distributions on the plane as weighted grid points, to multiply them by likelihoods that no formula integrates."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from tracker.geometry import Array


@dataclass(frozen=True, eq=False)
class GaussianGrid:
    """Grid points of n normal distributions of mean (n, 2) m and covariance (n, 2, 2) m².

    offset (n, k, 2) m: the points of each less its mean; weight (k,): their probabilities.
    cell: variance within a cell, as a share of the covariance.
    """

    mean: Array
    covariance: Array
    offset: Array
    weight: Array
    cell: float

    @staticmethod
    def of(mean: Array, covariance: Array, count: int, reach: float) -> GaussianGrid:
        """Grids with `count` points along each of two axes, up to `reach` standard deviations from the mean."""
        points, weight, cell = _standard_grid(count, reach)
        return GaussianGrid(mean, covariance, points @ np.linalg.cholesky(covariance).transpose(0, 2, 1), weight, cell)

    @property
    def points(self) -> Array:
        """The grid points (n, k, 2) m."""
        return np.asarray(self.mean[:, None] + self.offset)

    def posterior(self, likelihood: Array) -> tuple[Array, Array, Array]:
        """Mean (n, 2) m, covariance (n, 2, 2) m² and normalizer (n,) of the distributions times a likelihood (n, k) of the grid points."""
        weight = self.weight * likelihood
        total = weight.sum(axis=1)
        weight /= total[:, None]
        shift = np.einsum("nk,nki->ni", weight, self.offset)
        residual = self.offset - shift[:, None]
        # The variance within a cell bounds the posterior from below.
        return self.mean + shift, np.einsum("nk,nki,nkj->nij", weight, residual, residual) + self.cell * self.covariance, total


@cache
def _standard_grid(count: int, reach: float) -> tuple[Array, Array, float]:
    """Grid points (k, 2) of the standard normal distribution, their probabilities (k,), and the variance within a cell."""
    axis = np.linspace(-reach, reach, count)
    points = np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1).reshape(-1, 2)
    density = np.exp(-0.5 * (points**2).sum(axis=1))
    return points, density / density.sum(), float((axis[1] - axis[0]) ** 2 / 12)
