"""Fixed-lag smoothing of the global nearest neighbour tracker: the people of a tick are reported some ticks later, by all that came since.

The window holds filtered states, which are smoothed backwards step by step (rts_smoother.rts_step).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import final

import numpy as np

from tracker.geometry import Array, Mask
from tracker.tracks.rts_smoother import rts_step
from tracker.tracks.tracks import MotionParameters, Tracks, coasting_transition

MIN_DURATION = 16 / 7
"""s, least total time with a box of a deleted track that is reported, where the delay shows its deletion in time."""

BACKDATE = 2 / 7
"""s for which a person is reported before the first box, where the delay allows it, since nobody appears at once."""

MIN_MISS_PROBABILITY = 0.05
"""Least probability of a miss in all views for a person to be reported before the first box."""


@dataclass(frozen=True, eq=False)
class _WindowTick:
    """All tracks after a tick, which of them are confirmed, and the probability (n,) that all its views miss people at the places of given tracks."""

    tracks: Tracks
    confirmed: Mask
    miss_probability: Callable[[Tracks], Array]


@final
class GnnFixedLagSmoother:
    """Smoother with a window of the last `delay` ticks of all tracks. A delay of 0 reports at once."""

    def __init__(self, delay: int, period: float, motion: MotionParameters) -> None:
        """delay in ticks of `period` s. Raises ValueError where it is below 0."""
        if delay < 0:
            raise ValueError(f"delay is {delay} ticks, needs 0 or more")
        self.delay, self.period, self.motion = delay, period, motion
        self._window: deque[_WindowTick] = deque()

    def feed(self, tracks: Tracks, confirmed: Mask, miss_probability: Callable[[Tracks], Array]) -> Tracks | None:
        """Take a tick; the people of the tick `delay` before it, None where there is none.

        tracks and confirmed (t,): after the tick; miss_probability: probability (n,) that all views of the tick miss people at the places of tracks.
        """
        self._window.append(_WindowTick(tracks, confirmed, miss_probability))
        return self.drain() if len(self._window) > self.delay else None

    def drain(self) -> Tracks | None:
        """The people of the oldest tick that is not reported yet; None where all are."""
        if not self._window:
            return None
        people = self._oldest()
        self._window.popleft()
        return people

    def _oldest(self) -> Tracks:
        """The people of the oldest tick, smoothed.

        They are tracks that are confirmed in the window. Each has a box at the oldest tick or later, or is confirmed then and not deleted since.
        Tracks initiated soon after the oldest tick are added.
        """
        first, last = self._window[0], self._window[-1]
        confirmed, seen = set(first.tracks.tree[first.confirmed].tolist()), set(first.tracks.tree[first.tracks.misses == 0].tolist())
        for later in list(self._window)[1:]:
            confirmed |= set(later.tracks.tree[later.confirmed].tolist())
            seen |= set(later.tracks.tree[later.tracks.misses == 0].tolist())
        seen |= set(last.tracks.tree[last.confirmed].tolist())
        alive = set(last.tracks.tree.tolist())
        # A coasting track without expected detections is hidden, not gone.
        seen |= alive & set(first.tracks.tree[first.confirmed].tolist())
        hits: dict[int, int] = {}
        for tick_in_window in self._window:
            hits.update(zip(tick_in_window.tracks.tree.tolist(), tick_in_window.tracks.hits.tolist(), strict=True))
        # Most tracks deleted after a short time are duplicates beside a person.
        confirmed = {tree for tree in confirmed if tree in alive or hits[tree] * self.period >= MIN_DURATION}
        people, before = self._smoothed(0, confirmed & seen), set(first.tracks.tree.tolist())
        for tick in range(1, min(round(BACKDATE / self.period) + 1, len(self._window))):
            here = set(self._window[tick].tracks.tree.tolist())
            if new := (here & confirmed & seen) - before:
                early = self._backdated(self._smoothed(tick, new), tick * self.period)
                people = people.join(early.select(first.miss_probability(early) > MIN_MISS_PROBABILITY))
            before |= here
        return people

    def _backdated(self, tracks: Tracks, gap: float) -> Tracks:
        """The tracks extrapolated back by `gap` s."""
        F, Q = coasting_transition(tracks.misses, gap, self.motion)
        back = np.linalg.inv(F)
        state = (back @ tracks.state[:, :, None])[:, :, 0]
        return replace(tracks, state=state, covariance=back @ (tracks.covariance + Q) @ back.transpose(0, 2, 1))

    def _smoothed(self, tick: int, trees: set[int]) -> Tracks:
        """The tracks of the given trees at a tick of the window, smoothed by the later ticks."""
        tracks = self._window[tick].tracks
        states = [tracks.select(np.isin(tracks.tree, list(trees)))]
        for later in list(self._window)[tick + 1 :]:
            place = {tree: k for k, tree in enumerate(later.tracks.tree.tolist())}
            rows = [place[tree] for tree in states[-1].tree.tolist() if tree in place]
            states.append(later.tracks.select(np.array(rows, dtype=np.int64)))
        after = states.pop()
        while states:
            now = states.pop()
            continued = np.isin(now.tree, after.tree)
            x, P = now.state.copy(), now.covariance.copy()
            before = now.select(continued)
            F, Q = coasting_transition(before.misses, self.period, self.motion)
            x[continued], P[continued] = rts_step((before.state, before.covariance), (after.state, after.covariance), F, Q)
            after = replace(now, state=x, covariance=P)
        return after
