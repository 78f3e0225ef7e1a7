"""A fixed lag: what is said of a tick some ticks later, when it is known who came, who had gone, and which way people went on.

A track remembers its filtered states, which are smoothed step by step backwards (rts_smoother.rts_step).
"""

from __future__ import annotations

from typing import final

import numpy as np

from tracker.geometry import Mask
from tracker.mht.track_trees import TrackHypotheses, going
from tracker.tracks.rts_smoother import rts_step
from tracker.tracks.tracks import MotionParameters, Tracks


@final
class MhtFixedLagSmoother:
    """Who was there `delay` ticks ago, by what the tracks of the best hypothesis remember. A delay of 0 reports at once."""

    def __init__(self, delay: int, period: float, motion: MotionParameters) -> None:
        """delay in ticks of `period` s. Raises ValueError where it is below 0."""
        if delay < 0:
            raise ValueError(f"delay is {delay} ticks, needs 0 or more")
        self.delay, self.period, self.motion = delay, period, motion
        self._taken = self._told = 0
        self._last: tuple[TrackHypotheses, Mask] | None = None

    def feed(self, tracks: TrackHypotheses, here: Mask) -> Tracks | None:
        """Take the tracks after a tick, and which of them are people who are there now; the people of the tick `delay` before it."""
        self._taken += 1
        self._last = tracks, here
        return self.drain() if self._taken - self._told > self.delay else None

    def drain(self) -> Tracks | None:
        """The people of the oldest tick that was not told yet, by what is known now; None where all are."""
        if self._last is None or self._told == self._taken:
            return None
        tracks, here = self._last
        ago = self._taken - 1 - self._told
        self._told += 1
        # Somebody was there if seen then or since, or if not given up by now.
        there = (tracks.age > ago) & tracks.believed & (here | tracks.met[:, : ago + 1].any(axis=1))
        return smoothed(tracks.select(there), ago, (self.period, self.motion))


def smoothed(tracks: TrackHypotheses, ago: int, motion: tuple[float, MotionParameters]) -> Tracks:
    """The tracks as they were `ago` ticks before, with what came since taken into state and covariance; all are older than that."""
    x, P = tracks.past[:, 0], tracks.spread[:, 0]
    for k in range(1, ago + 1):
        x, P = rts_step((tracks.past[:, k], tracks.spread[:, k]), (x, P), *going(tracks.gap[:, k - 1], *motion))
    # How tall they are is not followed here.
    state, covariance = np.zeros((len(x), 5)), np.zeros((len(x), 5, 5))
    state[:, :4], covariance[:, :4, :4] = x, P
    return Tracks(tracks.tree, state, covariance, tracks.score, tracks.hits, tracks.misses, tracks.age)
