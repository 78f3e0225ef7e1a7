"""A fixed lag: what is said of a tick some ticks later, when it is known who came, who had gone, and which way people went on.

The window holds filtered states, which are smoothed step by step backwards (rts_smoother.rts_step).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import final

import numpy as np

from tracker.geometry import Array, Mask
from tracker.tracks.rts_smoother import rts_step
from tracker.tracks.tracks import MotionParameters, Tracks, onward

BRIEF = 16 / 7
"""s: a track that was seen for less and has ended is not told of, where the delay lets that be known."""

BEFORE = 2 / 7
"""s: so long before their first box people are told of, where the delay lets that be known: nobody comes from nowhere ..."""

MISSED = 0.05
"""... unless views would have shown them: they show no box of who is there more seldom."""


@dataclass(frozen=True, eq=False)
class _Moment:
    """All tracks after a tick, which of them are believed, and how likely (n,) its views show no box of people who are where given tracks are."""

    tracks: Tracks
    believed: Mask
    unseen: Callable[[Tracks], Array]


@final
class GnnFixedLagSmoother:
    """The last `delay` ticks of all tracks. A delay of 0 reports at once."""

    def __init__(self, delay: int, period: float, motion: MotionParameters) -> None:
        """delay in ticks of `period` s. Raises ValueError where it is below 0."""
        if delay < 0:
            raise ValueError(f"delay is {delay} ticks, needs 0 or more")
        self.delay, self.period, self.motion = delay, period, motion
        self._window: deque[_Moment] = deque()

    def feed(self, tracks: Tracks, believed: Mask, unseen: Callable[[Tracks], Array]) -> Tracks | None:
        """Take the tracks after a tick, which are believed, and how likely (n,) the tick's views show no box of who is where given tracks are; the
        people of the tick `delay` before it, None where there was none yet."""
        self._window.append(_Moment(tracks, believed, unseen))
        return self.drain() if len(self._window) > self.delay else None

    def drain(self) -> Tracks | None:
        """The people of the oldest tick that was not reported yet, by what is known now; None where all are."""
        if not self._window:
            return None
        people = self._oldest()
        self._window.popleft()
        return people

    def _oldest(self) -> Tracks:
        """Who was there at the oldest tick: believed by now, and seen then or again since, or believed then and not yet given up, or seen soon after
        for the first time."""
        first, last = self._window[0], self._window[-1]
        known, seen = set(first.tracks.tree[first.believed].tolist()), set(first.tracks.tree[first.tracks.misses == 0].tolist())
        for later in list(self._window)[1:]:
            known |= set(later.tracks.tree[later.believed].tolist())
            seen |= set(later.tracks.tree[later.tracks.misses == 0].tolist())
        seen |= set(last.tracks.tree[last.believed].tolist())
        going = set(last.tracks.tree.tolist())
        # Whom no view should have seen is still followed: out of sight, not gone.
        seen |= going & set(first.tracks.tree[first.believed].tolist())
        hits: dict[int, int] = {}
        for moment in self._window:
            hits.update(zip(moment.tracks.tree.tolist(), moment.tracks.hits.tolist(), strict=True))
        # What has ended after a short life was seldom somebody: duplicates beside a person are found out within seconds.
        known = {tree for tree in known if tree in going or hits[tree] * self.period >= BRIEF}
        people, before = self._smoothed(0, known & seen), set(first.tracks.tree.tolist())
        for tick in range(1, min(round(BEFORE / self.period) + 1, len(self._window))):
            here = set(self._window[tick].tracks.tree.tolist())
            if new := (here & known & seen) - before:
                early = self._before(self._smoothed(tick, new), tick * self.period)
                people = people.join(early.select(first.unseen(early) > MISSED))
            before |= here
        return people

    def _before(self, tracks: Tracks, gap: float) -> Tracks:
        """Where `tracks` were `gap` s ago: as they were then is not known but by how they went on."""
        F, Q = onward(tracks.misses, gap, self.motion)
        back = np.linalg.inv(F)
        state = (back @ tracks.state[:, :, None])[:, :, 0]
        return replace(tracks, state=state, covariance=back @ (tracks.covariance + Q) @ back.transpose(0, 2, 1))

    def _smoothed(self, tick: int, trees: set[int]) -> Tracks:
        """Those tracks of a tick of the window whose trees are given, with what came after taken into their states."""
        tracks = self._window[tick].tracks
        states = [tracks.select(np.isin(tracks.tree, list(trees)))]
        for later in list(self._window)[tick + 1 :]:
            place = {tree: k for k, tree in enumerate(later.tracks.tree.tolist())}
            rows = [place[tree] for tree in states[-1].tree.tolist() if tree in place]
            states.append(later.tracks.select(np.array(rows, dtype=np.int64)))
        after = states.pop()
        while states:
            now = states.pop()
            goes_on = np.isin(now.tree, after.tree)
            x, P = now.state.copy(), now.covariance.copy()
            before = now.select(goes_on)
            F, Q = onward(before.misses, self.period, self.motion)
            x[goes_on], P[goes_on] = rts_step((before.state, before.covariance), (after.state, after.covariance), F, Q)
            after = replace(now, state=x, covariance=P)
        return after
