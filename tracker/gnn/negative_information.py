"""Where people are of whom views show no box: most likely where these could hardly see them.

Who walked behind a wall and has not come out is still behind it, and of two places that a box leaves open another view that shows nobody at one
speaks for the other. What is expected of a place is multiplied by how likely the view shows nobody there, and has the mean and covariance of the
product then (assumed density filtering, as in tracker/vague.py). Where things that hide people are not known nothing follows.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tracker.detections.gaussian_grid import GaussianGrid
from tracker.detections.occlusion import Viewpoint
from tracker.geometry import Array, Ints, Mask
from tracker.tracks.sensor_model import SensorModel
from tracker.tracks.tracks import Tracks, informed

COUNT, REACH = 9, 2.7
"""Places along each of two axes at which lines of sight are drawn, and up to how many standard deviations."""


class ExpectedVisibility(NamedTuple):
    """share (t, v): how often each view should have a box of each track, of those whom it has in full view. rows (n,): the tracks whose places are
    not sure, cloud: where these may be, there (n, k, v): the same as `share` at each of the places."""

    share: Array
    rows: Ints
    cloud: GaussianGrid | None
    there: Array

    @staticmethod
    def of(tracks: Tracks, views: list[Viewpoint], evidence: SensorModel) -> ExpectedVisibility:
        """What `views` should have boxes of."""
        q, place, every = evidence.parameters, tracks.state[:, :2], np.arange(len(tracks))
        rows = every[tracks.doubt > q.unsure] if evidence.setup.occluders is not None else every[:0]
        cloud = GaussianGrid.of(place[rows], tracks.covariance[rows, :2, :2], COUNT, REACH) if len(rows) else None
        spots = cloud.places.reshape(-1, 2) if cloud else place[:0]
        who = np.concatenate([tracks.tree, np.repeat(tracks.tree[rows], COUNT**2)])
        share = evidence.bodies(np.concatenate([place, spots]), who, every).by_view(views, q.fusion.reach)
        share, there = share[: len(tracks)], share[len(tracks) :].reshape(len(rows), COUNT**2, len(views))
        if cloud:
            share[rows] = np.einsum("k,nkv->nv", cloud.share, there)
        return ExpectedVisibility(share, rows, cloud, there)

    def without(self, tracks: Tracks, seen: Mask, detection: Array) -> Tracks:
        """`tracks` as they are for views having no box of them; seen (t, v): which have one, or are not asked; detection (v,): how often each view
        has a box of who is in full view."""
        some = ~seen[self.rows].all(axis=1)
        if self.cloud is None or not some.any():
            return tracks
        nobody = np.where(seen[self.rows][:, None], 1.0, 1 - detection * self.there).prod(axis=2)
        mean, covariance, _ = self.cloud.where(nobody)
        rows = self.rows[some]
        place = np.broadcast_to(np.eye(2, 5), (len(rows), 2, 5))
        return informed(tracks, rows, place, (self.cloud.mean[some], self.cloud.covariance[some]), (mean[some], covariance[some]))
