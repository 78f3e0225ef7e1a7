"""Who was lost from sight and is followed again under another id: the same person, where that is likelier than somebody new.

A track that no view corrects soon says little of where a person is, and ends; who comes out from behind a wall seconds later starts a new one. Place
and time tell whose it is: people go on for a while as they went, and then anywhere.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.optimize import linear_sum_assignment

from tracker.geometry import Array, Mask
from tracker.tracks.tracks import MotionParameters, Tracks, halting

UNSEEN = 3
"""Ticks without a box after which a track may be of somebody who is followed anew already."""

UPRIGHT = 0.02
"""m, by which people may seem taller or shorter when they come back, for reasons that no filter knows ..."""

MOST = 4.0
"""... and log-likelihood ratio that statures count at most."""


@dataclass(frozen=True)
class ReidentificationParameters:
    """How people come back into sight."""

    memory: float = 8.0  # s, for how long somebody is looked for
    returns: float = 0.2  # chance that who was lost comes back at a tick, and is followed again
    wander: float = 0.6  # m²/s, how fast the variance of a place grows, an axis


class NewTargetModel(NamedTuple):
    """arrivals: people who appear, a square metre and tick; mean and standard deviation of how tall they are, m."""

    arrivals: float
    stature: float
    stature_sigma: float


@dataclass(frozen=True, eq=False)
class _Sight:
    """When and where somebody was seen last: tick; state (5,) and covariance (5, 5) as in Tracks."""

    tick: int
    state: Array
    covariance: Array


class Reidentification:
    """`person`: tree → the first tree of the same person, of those that are not the first."""

    def __init__(self, parameters: ReidentificationParameters, motion: MotionParameters, period: float, strangers: NewTargetModel) -> None:
        """period s of a tick."""
        self.parameters, self.motion, self.period, self.strangers = parameters, motion, period, strangers
        self.person: dict[int, int] = {}
        self._seen: dict[int, _Sight] = {}
        self._tick = 0

    def step(self, tracks: Tracks, known: Mask, fresh: Mask, left: set[int]) -> set[int]:
        """Take a tick; known (t,): who is believed, fresh (t,): who is for the first time; left: trees of those who went out of all views, and are
        not looked for. The trees that have gone on as another, and should end.
        """
        self._tick += 1
        for tree in left:
            self._seen.pop(tree, None)
        oldest = self._tick - self.parameters.memory / self.period
        self._seen = {tree: sight for tree, sight in self._seen.items() if sight.tick >= oldest}
        here = set(tracks.tree[tracks.misses < UNSEEN].tolist())
        lost, new = [tree for tree in self._seen if tree not in here], np.flatnonzero(fresh)
        # Somebody new, or nobody again, is what both are worth that are not paired.
        ratio = np.array([[self._ratio(self._seen[tree], tracks, k) for tree in lost] for k in new.tolist()]).reshape(len(new), len(lost))
        rows, columns = linear_sum_assignment(np.maximum(ratio, 0.0), maximize=True)
        ended = set()
        for i, j in zip(rows.tolist(), columns.tolist(), strict=True):
            if ratio[i, j] > 0:
                self.person[int(tracks.tree[new[i]])] = self.person.get(lost[j], lost[j])
                del self._seen[lost[j]]
                ended.add(lost[j])
        for k in np.flatnonzero(known & (tracks.misses == 0)):
            self._seen[int(tracks.tree[k])] = _Sight(self._tick, tracks.state[k], tracks.covariance[k])
        return ended

    def _ratio(self, sight: _Sight, tracks: Tracks, row: int) -> float:
        """log-likelihood ratio of the track in `row` being who was seen last at `sight`, against somebody new."""
        q, gap = self.parameters, (self._tick - sight.tick) * self.period
        F = np.hstack([np.eye(2), halting(gap, self.motion) * np.eye(2), np.zeros((2, 1))])
        S = F @ sight.covariance @ F.T + tracks.covariance[row, :2, :2] + q.wander * gap * np.eye(2)
        r = tracks.state[row, :2] - F @ sight.state
        density = -0.5 * (r @ np.linalg.solve(S, r) + np.log((2 * np.pi) ** 2 * np.linalg.det(S)))
        return float(density + self._as_tall(sight, tracks, row) + np.log(q.returns / self.strangers.arrivals))

    def _as_tall(self, sight: _Sight, tracks: Tracks, row: int) -> float:
        """log-likelihood ratio of what has been seen of the stature of the track in `row`, if it is that of `sight`, against anybody's."""
        usual, variance = self.strangers.stature, self.strangers.stature_sigma**2
        mean, spread = tracks.state[row, 4], tracks.covariance[row, 4, 4]
        if spread > 0.9 * variance:
            return 0.0
        # Without what was assumed at first, the same for all.
        noise = 1 / (1 / spread - 1 / variance)
        seen = noise * (mean / spread - usual / variance)
        same, other = (
            -0.5 * ((seen - m) ** 2 / (noise + v) + np.log(noise + v))
            for m, v in ((sight.state[4], sight.covariance[4, 4] + UPRIGHT**2), (usual, variance))
        )
        return float(np.clip(same - other, -MOST, MOST))

    def renamed(self, people: Tracks) -> Tracks:
        """`people` with the first tree of each person; where two are one person the later."""
        first = np.array([self.person.get(tree, tree) for tree in people.tree.tolist()], dtype=np.int64)
        later = (first[:, None] == first) & (people.tree[:, None] < people.tree)
        kept = ~later.any(axis=1)
        return replace(people, tree=first).select(kept)
