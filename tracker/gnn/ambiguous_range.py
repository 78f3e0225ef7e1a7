"""Tracks against vague boxes, which say in which direction somebody is, and of the distance what the world leaves open (range_likelihood.py).

Across the line of sight a track is corrected as by any measurement. Along it, what is expected of place and stature and what the box leaves open meet
place by place, and the mean and covariance of the product are what the track knows then (assumed density filtering: Maybeck 1982, Stochastic
models 2).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tracker.detections.ground_points import GroundDetections
from tracker.detections.range_likelihood import NEAREST, Expected
from tracker.geometry import Array, Ints
from tracker.tracks.tracks import Tracks, informed, update

FAINT = 0.01
"""A density, a radian, below which a box is not of somebody who is expected there."""


@dataclass(frozen=True, eq=False)
class AmbiguousUpdate:
    """Tracks (t,) and the vague boxes of a view, `box` (d,). along, across (d, 2): unit vectors of each line of sight. away, aside (t, d) m: how far
    the tracks are along it and beside it; variance (t, d) m²: of `aside`, box and track together. mean (t, d, 2) m and covariance (t, d, 2, 2) m² of
    how far along it a track is and of its stature, once the box has told how far beside.
    """

    feet: GroundDetections
    box: Ints
    along: Array
    across: Array
    away: Array
    aside: Array
    variance: Array
    mean: Array
    covariance: Array

    @staticmethod
    def of(tracks: Tracks, feet: GroundDetections, box: Ints, offset: Array, foot_spread: float) -> AmbiguousUpdate:
        """offset (t, 2) m: the view's own error on the ground."""
        along = _over_the_plane(feet, box)
        across = np.stack([-along[:, 1], along[:, 0]], axis=1)
        place, P = tracks.state[:, :2] + offset - feet.origin[:2], tracks.covariance
        away, aside = place @ along.T, place @ across.T
        A = _along_and_tall(along)
        beside = np.einsum("tij,dj->tdi", P[:, :, :2], across)
        variance = np.einsum("tdi,di->td", beside[..., :2], across) + feet.covariance[box, 0, 0] * away**2 + foot_spread**2
        shared = np.einsum("dij,tdj->tdi", A, beside)
        both = A[None] @ P[:, None] @ A[None].transpose(0, 1, 3, 2)
        mean = np.stack([away, np.broadcast_to(tracks.state[:, 4:], away.shape)], axis=2) - shared * (aside / variance)[..., None]
        covariance = both - shared[..., :, None] * shared[..., None, :] / variance[..., None, None]
        return AmbiguousUpdate(feet, box, along, across, away, aside, variance, mean, covariance)

    def density(self, gate: float) -> Array:
        """log density (t, d) of the boxes, a radian across and a radian along; −inf beyond `gate` standard deviations, or where nobody can stand."""
        assert self.feet.lines is not None
        out = np.full(self.away.shape, -np.inf)
        t, d = np.nonzero((self.aside**2 < gate**2 * self.variance) & (self.away > NEAREST / 2))
        along = self.feet.lines.density(self.box[d], Expected(self.mean[t, d], self.covariance[t, d]))
        variance, away = self.variance[t, d], self.away[t, d]
        across = np.log(away) - 0.5 * (self.aside[t, d] ** 2 / variance + np.log(2 * np.pi * variance))
        out[t, d] = np.where(along > FAINT, across + np.log(np.maximum(along, FAINT)), -np.inf)
        return out

    def correct(self, tracks: Tracks, t: int, d: int) -> Tracks:
        """Give track `t` the box in column `d`."""
        assert self.feet.lines is not None
        w = self.across[d]
        tracks = update(tracks, t, -self.aside[t, d, None], w[None], np.array([[self.variance[t, d] - w @ tracks.covariance[t, :2, :2] @ w]]))
        before = Expected(self.mean[t, d, None], self.covariance[t, d, None])
        after = self.feet.lines.meet(self.box[d, None], before)
        return informed(tracks, np.array([t]), _along_and_tall(self.along[d, None]), before, after)


def initiated_along_ray(tracks: Tracks, t: int, feet: GroundDetections, d: int) -> Tracks:
    """Track `t`, which starts from the vague box `d` of a view, with the stature that goes with each place."""
    assert feet.lines is not None
    box = np.array([d])
    (u,), (mean,), (P,) = _over_the_plane(feet, box), *feet.lines.start(box)
    taller = P[0, 1] / P[0, 0]
    state, covariance = tracks.state.copy(), tracks.covariance.copy()
    place = covariance[t, :2, :2]
    state[t, 4] = mean[1] + taller * (u @ (state[t, :2] - feet.origin[:2]) - mean[0])
    covariance[t, :2, 4] = covariance[t, 4, :2] = taller * place @ u
    covariance[t, 4, 4] = P[1, 1] - taller * P[0, 1] + taller**2 * u @ place @ u
    return replace(tracks, state=state, covariance=covariance)


def _over_the_plane(feet: GroundDetections, box: Ints) -> Array:
    """(d, 2): unit vectors of lines of sight as seen from above."""
    return np.asarray(feet.direction[box, :2] / np.hypot(*feet.direction[box, :2].T)[:, None])


def _along_and_tall(along: Array) -> Array:
    """(d, 2, 5): what of a track's state is the distance along unit vectors (d, 2), and what the stature."""
    A = np.zeros((len(along), 2, 5))
    A[:, 0, :2], A[:, 1, 4] = along, 1.0
    return A
