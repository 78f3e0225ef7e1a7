"""Update of tracks by boxes of ambiguous range, which give a direction and a likelihood of the distance (detections/range_likelihood.py).

Across the line of sight the update is that of a Kalman filter. Along it, the predicted distribution of distance and stature is multiplied by the
likelihood on a grid. The track keeps the mean and covariance of the product (assumed density filtering: Maybeck 1982, Stochastic models 2).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tracker.detections.ground_points import GroundDetections
from tracker.detections.range_likelihood import NEAREST, RangePrior
from tracker.geometry import Array, Ints
from tracker.tracks.tracks import Tracks, update, with_marginal

MIN_DENSITY = 0.01
"""Least density, a radian, of a box in the gate of a track."""


@dataclass(frozen=True, eq=False)
class AmbiguousUpdate:
    """All t tracks against the d ambiguous boxes `box` (d,) of a view.

    along, across (d, 2): horizontal unit vectors along and across each line of sight. distance, cross_range (t, d) m: place of each track along and
    across it; variance (t, d) m²: of `cross_range`, of box and track together. mean (t, d, 2) m and covariance (t, d, 2, 2) m²: of distance and
    stature after the update across the line of sight.
    """

    feet: GroundDetections
    box: Ints
    along: Array
    across: Array
    distance: Array
    cross_range: Array
    variance: Array
    mean: Array
    covariance: Array

    @staticmethod
    def of(tracks: Tracks, feet: GroundDetections, box: Ints, bias: Array, foot_spread: float) -> AmbiguousUpdate:
        """bias (t, 2) m: registration bias of the view at each track; foot_spread m: standard deviation of feet from the ground under the body."""
        along = _horizontal_directions(feet, box)
        across = np.stack([-along[:, 1], along[:, 0]], axis=1)
        place, P = tracks.state[:, :2] + bias - feet.origin[:2], tracks.covariance
        distance, cross_range = place @ along.T, place @ across.T
        A = _range_and_stature(along)
        cross = np.einsum("tij,dj->tdi", P[:, :, :2], across)
        variance = np.einsum("tdi,di->td", cross[..., :2], across) + feet.covariance[box, 0, 0] * distance**2 + foot_spread**2
        shared = np.einsum("dij,tdj->tdi", A, cross)
        both = A[None] @ P[:, None] @ A[None].transpose(0, 1, 3, 2)
        mean = np.stack([distance, np.broadcast_to(tracks.state[:, 4:], distance.shape)], axis=2) - shared * (cross_range / variance)[..., None]
        covariance = both - shared[..., :, None] * shared[..., None, :] / variance[..., None, None]
        return AmbiguousUpdate(feet, box, along, across, distance, cross_range, variance, mean, covariance)

    def density(self, gate: float) -> Array:
        """log density (t, d) of the boxes, a radian across and a radian along; −inf outside the gate, which is `gate` standard deviations wide."""
        assert self.feet.ranges is not None
        out = np.full(self.distance.shape, -np.inf)
        t, d = np.nonzero((self.cross_range**2 < gate**2 * self.variance) & (self.distance > NEAREST / 2))
        along = self.feet.ranges.density(self.box[d], RangePrior(self.mean[t, d], self.covariance[t, d]))
        variance, distance = self.variance[t, d], self.distance[t, d]
        across = np.log(distance) - 0.5 * (self.cross_range[t, d] ** 2 / variance + np.log(2 * np.pi * variance))
        out[t, d] = np.where(along > MIN_DENSITY, across + np.log(np.maximum(along, MIN_DENSITY)), -np.inf)
        return out

    def correct(self, tracks: Tracks, t: int, d: int) -> Tracks:
        """The tracks with track `t` updated by the box in column `d`."""
        assert self.feet.ranges is not None
        w = self.across[d]
        tracks = update(tracks, t, -self.cross_range[t, d, None], w[None], np.array([[self.variance[t, d] - w @ tracks.covariance[t, :2, :2] @ w]]))
        before = RangePrior(self.mean[t, d, None], self.covariance[t, d, None])
        after = self.feet.ranges.posterior(self.box[d, None], before)
        return with_marginal(tracks, np.array([t]), _range_and_stature(self.along[d, None]), before, after)


def initiated_along_ray(tracks: Tracks, t: int, feet: GroundDetections, d: int) -> Tracks:
    """The tracks with track `t`, initiated from the ambiguous box `d` of a view, given the correlation of its place and stature."""
    assert feet.ranges is not None
    box = np.array([d])
    (u,), (mean,), (P,) = _horizontal_directions(feet, box), *feet.ranges.initial(box)
    slope = P[0, 1] / P[0, 0]
    state, covariance = tracks.state.copy(), tracks.covariance.copy()
    place = covariance[t, :2, :2]
    state[t, 4] = mean[1] + slope * (u @ (state[t, :2] - feet.origin[:2]) - mean[0])
    covariance[t, :2, 4] = covariance[t, 4, :2] = slope * place @ u
    covariance[t, 4, 4] = P[1, 1] - slope * P[0, 1] + slope**2 * u @ place @ u
    return replace(tracks, state=state, covariance=covariance)


def _horizontal_directions(feet: GroundDetections, box: Ints) -> Array:
    """Horizontal unit vectors (d, 2) of the lines of sight."""
    return np.asarray(feet.direction[box, :2] / np.hypot(*feet.direction[box, :2].T)[:, None])


def _range_and_stature(along: Array) -> Array:
    """Matrices (d, 2, 5) from a track's state to its distance along unit vectors (d, 2) and its stature."""
    A = np.zeros((len(along), 2, 5))
    A[:, 0, :2], A[:, 1, 4] = along, 1.0
    return A
