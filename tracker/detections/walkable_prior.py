"""Scene prior of where people can stand: outside solid objects, on ground that is not too steep, within the map.

The prior multiplies the predicted distribution of a place, on weighted grid points. The mean and covariance of the product are kept (assumed
density filtering: Maybeck 1982, Stochastic models 2). So the prediction of a hidden person who walks towards a wall stops before it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.special import ndtr

from tracker.geometry import Array
from tracker.geometry.ground import Grid, Ground

COUNT, REACH = 13, 3.0
"""Grid points along each of two axes, and their extent in standard deviations."""


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
    def of(mean: Array, covariance: Array) -> GaussianGrid:
        """Grids with COUNT points along each of two axes, up to REACH standard deviations from the mean."""
        points, weight, cell = _standard_grid()
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
def _standard_grid() -> tuple[Array, Array, float]:
    """Grid points (k, 2) of the standard normal distribution, their probabilities (k,), and the variance within a cell."""
    axis = np.linspace(-REACH, REACH, COUNT)
    points = np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1).reshape(-1, 2)
    density = np.exp(-0.5 * (points**2).sum(axis=1))
    return points, density / density.sum(), float((axis[1] - axis[0]) ** 2 / 12)


SOLID_HEIGHT = 0.3
"""m over the ground above which nobody stands on an object."""

EDGE_SIGMA = 0.15
"""m, standard deviation of the edges of objects in the map."""

MAX_SLOPE, MAX_SLOPE_SIGMA, SLOPE_WINDOW = 0.5, 0.1, 0.6
"""Slope (rise over run) that halves the prior, the standard deviation of that limit, and the length over which slopes are taken, m."""

FLOOR = 0.02
"""Prior of places where nobody should stand: maps miss doors and stairs."""


@dataclass(frozen=True, eq=False)
class WalkablePrior:
    """Prior (rows, columns) at the points of a grid, relative to free and level ground, which has 1.

    origin (2,) m and spacing m: as of Grid. Beyond the grid it is FLOOR.
    """

    prior: Array
    origin: Array
    spacing: float

    @staticmethod
    @lru_cache(maxsize=8)
    def of(ground: Ground, tops: Ground | None) -> WalkablePrior | None:
        """The prior of a ground and the tops of the objects on it; None unless both are grids of the same points."""
        if not (isinstance(ground, Grid) and isinstance(tops, Grid) and _same_points(ground, tops)):
            return None
        solid = tops.heights - ground.heights > SOLID_HEIGHT
        clearance = (_depth(~solid) - _depth(solid)) * ground.spacing
        window = max(1, round(SLOPE_WINDOW / ground.spacing))
        smooth = ndimage.uniform_filter(ground.heights, window, mode="nearest")
        # The minimum admits the level ground right above and right below a step.
        slope = ndimage.minimum_filter(np.hypot(*np.gradient(smooth, ground.spacing)), window, mode="nearest")
        free = ndtr(clearance / EDGE_SIGMA) * ndtr((MAX_SLOPE - slope) / MAX_SLOPE_SIGMA)
        return WalkablePrior(FLOOR + (1 - FLOOR) * free, ground.origin, ground.spacing)

    def at(self, points: Array) -> Array:
        """Prior (...) at points (..., 2) m."""
        index = np.rint((points - self.origin) / self.spacing).astype(np.int64)
        end = np.array(self.prior.shape)[::-1] - 1
        column, row = np.moveaxis(np.clip(index, 0, end), -1, 0)
        return np.where(((index >= 0) & (index <= end)).all(axis=-1), self.prior[row, column], FLOOR)

    def posterior(self, mean: Array, covariance: Array) -> tuple[Array, Array, Array]:
        """Mean (n, 2) m and covariance (n, 2, 2) m² of n normal distributions times the prior, and the prior's expectation (n,) under each."""
        grid = GaussianGrid.of(mean, covariance)
        return grid.posterior(self.at(grid.points))


def _same_points(one: Grid, other: Grid) -> bool:
    return one.heights.shape == other.heights.shape and one.spacing == other.spacing and np.array_equal(one.origin, other.origin)


def _depth(mask: NDArray[np.bool_]) -> Array:
    """Distance, in cells, of each point of `mask` to the nearest point outside it; 0 outside, the grid's length where the mask is full."""
    return np.asarray(ndimage.distance_transform_edt(mask)) if not mask.all() else np.full(mask.shape, float(max(mask.shape)))
