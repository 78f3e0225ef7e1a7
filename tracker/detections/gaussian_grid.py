"""Normal distributions on the plane as so many places each, for what no formula integrates: walls, banks, lines of sight."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from tracker.geometry import Array


@dataclass(frozen=True, eq=False)
class GaussianGrid:
    """mean (n, 2) m and covariance (n, 2, 2) m² of each distribution; apart (n, k, 2) m: its places from the mean on; share (k,): how much of it
    is at each; cell: the variance within one of them, as a share of that of all."""

    mean: Array
    covariance: Array
    apart: Array
    share: Array
    cell: float

    @staticmethod
    def of(mean: Array, covariance: Array, count: int, reach: float) -> GaussianGrid:
        """With `count` places along each of two axes, up to `reach` standard deviations from the mean."""
        places, share, cell = _pattern(count, reach)
        return GaussianGrid(mean, covariance, places @ np.linalg.cholesky(covariance).transpose(0, 2, 1), share, cell)

    @property
    def places(self) -> Array:
        """(n, k, 2) m."""
        return np.asarray(self.mean[:, None] + self.apart)

    def where(self, likely: Array) -> tuple[Array, Array, Array]:
        """Mean (n, 2) m and covariance (n, 2, 2) m² of these times what is `likely` (n, k) at each place, and how likely (n,) that is in all."""
        share = self.share * likely
        total = share.sum(axis=1)
        share /= total[:, None]
        moved = np.einsum("nk,nki->ni", share, self.apart)
        apart = self.apart - moved[:, None]
        # Nothing is known better than the places lie apart.
        return self.mean + moved, np.einsum("nk,nki,nkj->nij", share, apart, apart) + self.cell * self.covariance, total


@cache
def _pattern(count: int, reach: float) -> tuple[Array, Array, float]:
    """Places (k, 2) in standard deviations, how much of a normal distribution is at each (k,), and the variance within one."""
    axis = np.linspace(-reach, reach, count)
    places = np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1).reshape(-1, 2)
    bell = np.exp(-0.5 * (places**2).sum(axis=1))
    return places, bell / bell.sum(), float((axis[1] - axis[0]) ** 2 / 12)
