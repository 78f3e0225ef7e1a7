"""Tracks against vague boxes, which say in which direction somebody is, and of the distance what the world leaves open (tracker/standpoints.py).

Across the line of sight a track is corrected as by any measurement. Along it, what is expected and what the box leaves open meet place by place, and
the mean and variance of the product are what the track knows then (assumed density filtering: Maybeck 1982, Stochastic models 2).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tracker.fusion import Feet
from tracker.geometry import Array
from tracker.measurements import Ints
from tracker.standpoints import NEAREST
from tracker.trees import Tracks, update

FAINT = 0.01
"""A density, a radian, below which a box is not of somebody who is expected there."""


@dataclass(frozen=True, eq=False)
class Meeting:
    """Tracks (t,) and the vague boxes of a view, `box` (d,). along, across (d, 2): unit vectors of each line of sight. away, aside (t, d) m: how far
    the tracks are along it and beside it; variance (t, d) m²: of `aside`, box and track together. expected (t, d) m, spread (t, d) m²: how far
    along it a track is, once the box has told how far beside.
    """

    feet: Feet
    box: Ints
    along: Array
    across: Array
    away: Array
    aside: Array
    variance: Array
    expected: Array
    spread: Array

    @staticmethod
    def of(tracks: Tracks, feet: Feet, box: Ints, offset: Array, foot_spread: float) -> Meeting:
        """offset (2,) m: the view's own error on the ground."""
        along = feet.direction[box, :2] / np.hypot(*feet.direction[box, :2].T)[:, None]
        across = np.stack([-along[:, 1], along[:, 0]], axis=1)
        place, P = tracks.state[:, :2] + offset - feet.origin[:2], tracks.covariance[:, :2, :2]
        away, aside = place @ along.T, place @ across.T
        Pu, Pw = (np.einsum("tij,dj->tdi", P, axis) for axis in (along, across))
        shared = (Pw * along).sum(axis=2)
        variance = (Pw * across).sum(axis=2) + feet.covariance[box, 0, 0] * away**2 + foot_spread**2
        expected, spread = away - shared / variance * aside, (Pu * along).sum(axis=2) - shared**2 / variance
        return Meeting(feet, box, along, across, away, aside, variance, expected, spread)

    def density(self, gate: float) -> Array:
        """log density (t, d) of the boxes, a radian across and a radian along; −inf beyond `gate` standard deviations, or where nobody can stand."""
        assert self.feet.lines is not None
        out = np.full(self.away.shape, -np.inf)
        t, d = np.nonzero((self.aside**2 < gate**2 * self.variance) & (self.away > NEAREST / 2))
        along, _, _ = self.feet.lines.meet(self.box[d], self.expected[t, d], self.spread[t, d])
        variance, away = self.variance[t, d], self.away[t, d]
        across = np.log(away) - 0.5 * (self.aside[t, d] ** 2 / variance + np.log(2 * np.pi * variance))
        out[t, d] = np.where(along > FAINT, across + np.log(np.maximum(along, FAINT)), -np.inf)
        return out

    def correct(self, tracks: Tracks, t: int, d: int) -> Tracks:
        """Give track `t` the box in column `d`."""
        assert self.feet.lines is not None
        P = tracks.covariance[t, :2, :2]
        u, w = self.along[d], self.across[d]
        tracks = update(tracks, t, -self.aside[t, d, None], w[None], np.array([[self.variance[t, d] - w @ P @ w]]))
        _, mean, variance = self.feet.lines.meet(self.box[d, None], self.expected[t, d, None], self.spread[t, d, None])
        before = float(u @ tracks.covariance[t, :2, :2] @ u)
        if not 0 < variance[0] < before:
            return tracks
        # The measurement that, in a filter of Kalman, leaves just this mean and variance.
        R = 1 / (1 / variance[0] - 1 / before)
        return update(tracks, t, (mean - self.expected[t, d]) * (before + R) / before, u[None], np.array([[R]]))
