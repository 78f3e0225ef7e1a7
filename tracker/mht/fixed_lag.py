"""Fixed-lag smoothing of the tracks of the global hypothesis: the tick `delay` ticks ago, given all measurements up to now.

A leaf remembers its filtered states, which the fixed-interval smoother goes through backwards (Rauch, Tung, Striebel 1965, Maximum likelihood
estimates of linear dynamic systems).
"""

from __future__ import annotations

from typing import final

import numpy as np

from tracker.geometry import Mask
from tracker.mht.track_trees import TrackHypotheses, position_sigma
from tracker.tracks.tracks import MotionParameters, Tracks, coasting_transition


@final
class MhtFixedLagSmoother:
    """The people of `delay` ticks ago, from the memory of the tracks in the global hypothesis. A delay of 0 reports at once."""

    def __init__(self, delay: int, period: float, motion: MotionParameters, hidden_sigma: float) -> None:
        """delay in ticks of `period` s. hidden_sigma m: standard deviation of a place up to which a hidden person is reported who is not seen again.

        Raises ValueError where delay is below 0.
        """
        if delay < 0:
            raise ValueError(f"delay is {delay} ticks, needs 0 or more")
        self.delay, self.period, self.motion, self.hidden_sigma = delay, period, motion, hidden_sigma
        self._taken = self._reported = 0
        self._last: tuple[TrackHypotheses, Mask] | None = None

    def feed(self, tracks: TrackHypotheses, present: Mask) -> Tracks | None:
        """Take the tracks (n,) after a tick, and which are present; the people of the tick `delay` ticks before, None at the start."""
        self._taken += 1
        self._last = tracks, present
        return self.drain() if self._taken - self._reported > self.delay else None

    def drain(self) -> Tracks | None:
        """The people of the oldest tick that is not reported yet; None where all are."""
        if self._last is None or self._reported == self._taken:
            return None
        tracks, present = self._last
        ago = self._taken - 1 - self._reported
        self._reported += 1
        # A person was there if detected at that tick or later, if still present, or if hidden for so short a time that the place was known.
        hidden = ~tracks.deleted & (tracks.out_of_view == 0) & (position_sigma(tracks.covariances[:, ago]) <= self.hidden_sigma)
        there = (tracks.age > ago) & tracks.confirmed & (present | hidden | tracks.detected[:, : ago + 1].any(axis=1))
        return smoothed(tracks.select(there), ago, self.period, self.motion)


def smoothed(tracks: TrackHypotheses, ago: int, period: float, motion: MotionParameters) -> Tracks:
    """The smoothed tracks of `ago` ticks before; all are older than that. period: s of a tick."""
    x, P = tracks.states[:, 0], tracks.covariances[:, 0]
    for k in range(1, ago + 1):
        (F, Q), state, covariance = coasting_transition(tracks.past_misses[:, k - 1], period, motion), tracks.states[:, k], tracks.covariances[:, k]
        predicted = F @ covariance @ F.transpose(0, 2, 1) + Q
        C = np.linalg.solve(predicted, F @ covariance).transpose(0, 2, 1)
        x = state + (C @ (x[:, :, None] - F @ state[:, :, None]))[:, :, 0]
        P = covariance + C @ (P - predicted) @ C.transpose(0, 2, 1)
    return Tracks(tracks.tree, x, P, tracks.score, tracks.misses)
