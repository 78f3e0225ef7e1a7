"""Negative information: missed detections tell where a person is not (Koch 2007, On exploiting negative sensor evidence).

A person who walks behind a wall and does not come out is still behind it. Of two places that a box leaves open, another view without a box at one
supports the other. The predicted distribution of a place is multiplied by the likelihood of the missed detections. The track keeps the mean and
covariance of the product (assumed density filtering: Maybeck 1982). This needs known occluders.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tracker.detections.gaussian_grid import GaussianGrid
from tracker.detections.occlusion import Viewpoint
from tracker.geometry import Array, Ints, Mask
from tracker.tracks.sensor_model import SensorModel
from tracker.tracks.tracks import Tracks, with_marginal

COUNT, REACH = 9, 2.7
"""Grid points along each of two axes, and their extent in standard deviations."""


class ExpectedVisibility(NamedTuple):
    """Expected detection of all tracks in all views.

    share (t, v): detection rate relative to people in full view. rows (n,): the tracks of uncertain place; grid: their places;
    grid_share (n, k, v): `share` at each grid point.
    """

    share: Array
    rows: Ints
    grid: GaussianGrid | None
    grid_share: Array

    @staticmethod
    def of(tracks: Tracks, views: list[Viewpoint], sensor_model: SensorModel) -> ExpectedVisibility:
        """The expected detection of tracks in `views`."""
        q, place, every = sensor_model.parameters, tracks.state[:, :2], np.arange(len(tracks))
        rows = every[tracks.position_sigma > q.sampling_sigma] if sensor_model.setup.occluders is not None else every[:0]
        grid = GaussianGrid.of(place[rows], tracks.covariance[rows, :2, :2], COUNT, REACH) if len(rows) else None
        points = grid.points.reshape(-1, 2) if grid else place[:0]
        tree = np.concatenate([tracks.tree, np.repeat(tracks.tree[rows], COUNT**2)])
        share = sensor_model.bodies(np.concatenate([place, points]), tree, every).expected_by_view(views, q.fusion.reach)
        share, grid_share = share[: len(tracks)], share[len(tracks) :].reshape(len(rows), COUNT**2, len(views))
        if grid:
            share[rows] = np.einsum("k,nkv->nv", grid.weight, grid_share)
        return ExpectedVisibility(share, rows, grid, grid_share)

    def given_misses(self, tracks: Tracks, seen: Mask, detection: Array) -> Tracks:
        """The tracks updated by their missed detections.

        seen (t, v): which views have a box of a track, or are left out; detection (v,): detection rate of people in full view.
        """
        some = ~seen[self.rows].all(axis=1)
        if self.grid is None or not some.any():
            return tracks
        likelihood = np.where(seen[self.rows][:, None], 1.0, 1 - detection * self.grid_share).prod(axis=2)
        mean, covariance, _ = self.grid.posterior(likelihood)
        rows = self.rows[some]
        place = np.broadcast_to(np.eye(2, 5), (len(rows), 2, 5))
        return with_marginal(tracks, rows, place, (self.grid.mean[some], self.grid.covariance[some]), (mean[some], covariance[some]))
