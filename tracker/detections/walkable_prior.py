"""Where people can be in worlds that are known: not in what is solid, nor where the ground is too steep to stand on, nor beyond its end.

What is expected of a place is multiplied by how likely somebody is there, and has the mean and covariance of the product then (assumed density
filtering, as in tracker/gnn/ambiguous_range.py). Who walks out of sight towards a wall so comes to a halt before it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.special import ndtr

from tracker.detections.gaussian_grid import GaussianGrid
from tracker.geometry import Array
from tracker.geometry.ground import Grid, Ground

COUNT, REACH = 13, 3.0
"""Places along each of two axes at which is looked, and up to how many standard deviations."""


@dataclass(frozen=True)
class FootingParameters:
    """What is assumed of people and maps."""

    solid: float = 0.3  # m over the ground from which on a thing is nothing to stand on
    blur: float = 0.15  # m, standard deviation of where a thing ends in the map
    steep: tuple[float, float] = (0.5, 0.1)  # slope (rise over run) on which half as many stand as on the level, and how gradually that comes ...
    stride: float = 0.6  # ... over so many m
    least: float = 0.02  # how likely somebody is where nobody should be: maps do not know all doors and stairs


@dataclass(frozen=True, eq=False)
class WalkablePrior:
    """likely (rows, columns): how likely somebody is at each point of a grid, beside free and level ground; least: the same beyond the grid; origin
    (2,) m, spacing m as of Grid."""

    likely: Array
    origin: Array
    spacing: float
    least: float

    @staticmethod
    @lru_cache(maxsize=8)
    def of(ground: Ground, tops: Ground | None, q: FootingParameters) -> WalkablePrior | None:
        """Of the ground and the tops of what stands on it; None where they are not known at the same grid points."""
        if not (isinstance(ground, Grid) and isinstance(tops, Grid) and _same_points(ground, tops)):
            return None
        solid = tops.heights - ground.heights > q.solid
        away = (_depth(~solid) - _depth(solid)) * ground.spacing
        stride = max(1, round(q.stride / ground.spacing))
        smooth = ndimage.uniform_filter(ground.heights, stride, mode="nearest")
        # Above and below a step one stands well.
        slope = ndimage.minimum_filter(np.hypot(*np.gradient(smooth, ground.spacing)), stride, mode="nearest")
        free = ndtr(away / q.blur) * ndtr((q.steep[0] - slope) / q.steep[1])
        return WalkablePrior(q.least + (1 - q.least) * free, ground.origin, ground.spacing, q.least)

    def at(self, points: Array) -> Array:
        """(..., 2) m → (...) how likely somebody is there."""
        index = np.rint((points - self.origin) / self.spacing).astype(np.int64)
        end = np.array(self.likely.shape)[::-1] - 1
        column, row = np.moveaxis(np.clip(index, 0, end), -1, 0)
        return np.where(((index >= 0) & (index <= end)).all(axis=-1), self.likely[row, column], self.least)

    def meet(self, mean: Array, covariance: Array) -> tuple[Array, Array, Array]:
        """Places (n, 2) m with covariance (n, 2, 2) m²: both when people are where they can be, and how likely (n,) they are."""
        cloud = GaussianGrid.of(mean, covariance, COUNT, REACH)
        return cloud.where(self.at(cloud.places))


def _same_points(one: Grid, other: Grid) -> bool:
    return one.heights.shape == other.heights.shape and one.spacing == other.spacing and np.array_equal(one.origin, other.origin)


def _depth(mask: NDArray[np.bool_]) -> Array:
    """How many cells each point of `mask` is from the nearest that is not of it, 0 elsewhere; as many as the grid has where all are."""
    return np.asarray(ndimage.distance_transform_edt(mask)) if not mask.all() else np.full(mask.shape, float(max(mask.shape)))
