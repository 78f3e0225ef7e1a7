"""Negative information: missed detections tell where a person is not (Koch 2007, On exploiting negative sensor evidence).

A person who walks behind a wall and does not come out is still behind it. Of two places that a box leaves open, another view without a box at one
supports the other. The predicted distribution of a place is multiplied by the likelihood of the missed detections. The leaf keeps the mean and
covariance of the product (assumed density filtering: Maybeck 1982). This needs known occluders.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tracker.detections.occlusion import Viewpoint
from tracker.detections.walkable_prior import GaussianGrid
from tracker.geometry import Array, Ints, Mask
from tracker.mht.track_trees import TrackHypotheses
from tracker.tracks.sensor_model import SensorModel
from tracker.tracks.tracks import Places, with_places

COUNT, REACH = 9, 2.7
"""Grid points along each of two axes, and their extent in standard deviations."""

SAMPLING_SIGMA = 0.3
"""m, standard deviation of a place above which visibility is averaged over the grid."""


class ExpectedVisibility(NamedTuple):
    """Expected detection of all leaves in all views.

    share (n, v): detection rate relative to people in full view. rows (m,): the leaves of uncertain place; grid: their places;
    grid_share (m, k, v): `share` at each grid point.
    """

    share: Array
    rows: Ints
    grid: GaussianGrid | None
    grid_share: Array

    @staticmethod
    def of(
        leaves: TrackHypotheses, views: list[Viewpoint], sensor_model: SensorModel, people: Ints, missed: Mask | None = None
    ) -> ExpectedVisibility:
        """The expected detection of leaves in `views`; people: rows of those who may occlude others.

        missed (n, v): the leaves and views that `given_misses` will need; `share` and `grid_share` are 0 elsewhere. By default all.
        """
        q, place = sensor_model.parameters, leaves.state[:, :2]
        known = sensor_model.setup.occluders is not None
        uncertain = (leaves.position_sigma > SAMPLING_SIGMA) & ~leaves.deleted & known
        rows = np.flatnonzero(uncertain if missed is None else uncertain & missed.any(axis=1))
        grid = GaussianGrid.of(place[rows], leaves.covariance[rows, :2, :2], COUNT, REACH) if len(rows) else None
        points = grid.points.reshape(-1, 2) if grid else place[:0]
        tree = np.concatenate([leaves.tree, np.repeat(leaves.tree[rows], COUNT**2)])
        wanted = None if missed is None else np.concatenate([missed, np.repeat(missed[rows], COUNT**2, axis=0)])
        share = sensor_model.bodies(np.concatenate([place, points]), tree, people).expected_by_view(views, q.fusion.reach, wanted)
        share, grid_share = share[: len(leaves)], share[len(leaves) :].reshape(len(rows), COUNT**2, len(views))
        if grid:
            share[rows] = np.einsum("k,nkv->nv", grid.weight, grid_share)
        return ExpectedVisibility(share, rows, grid, grid_share)

    def given_misses(self, state: Array, covariance: Array, seen: Mask, detection: Array) -> tuple[Array, Array]:
        """States (n, 5) and covariances (n, 5, 5) updated by the missed detections.

        seen (n, v): which views have a box of a leaf, or are left out; detection (v,): detection rate of people in full view.
        """
        some = ~seen[self.rows].all(axis=1)
        if self.grid is None or not some.any():
            return state, covariance
        likelihood = np.where(seen[self.rows][:, None], 1.0, 1 - detection * self.grid_share).prod(axis=2)
        mean, spread, _ = self.grid.posterior(likelihood)
        before, after = Places(self.grid.mean[some], self.grid.covariance[some]), Places(mean[some], spread[some])
        return with_places(state, covariance, self.rows[some], before, after)
