"""Which tracks are of things that look like people: furniture, posts, pictures. Several views detect them again and again.

A track is of a person or of a thing. Three features of a track give the log-odds of a thing:

* the mean rank of the confidences of its boxes among all boxes of their views, which is lower for things;
* its detections over the expected ones, which are fewer for things;
* whether it has moved; if not, how long it has stood.

The first two enter as differences below their usual values for people. The log-odds are linear in them, with slopes by logistic regression on the
population of `pilsim tune`. The share of things among tracks and the usual values are estimated with the odds at each tick, by expectation
maximization (Dempster et al. 1977).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import expit, logit

from tracker.geometry import Array, Ints, Mask

SHARE, PRIOR_TRACKS = 0.08, 40.0
"""Prior share of things among tracks, and number of tracks for which it counts."""
USUAL, WEIGHT_USUAL = np.array([0.6, 0.85]), 0.5
"""Prior usual values of people: rank, detections over expected ones; and number of people for whom they count."""
WEIGHT_STANDING = 0.3
"""Weight of a track that has not moved in the usual values of people, as it may be of a thing."""
SLOPES = np.array([4.6, 10.4])
"""Log-odds of a thing per unit by which each of the first two features is below its usual value."""
LEAST_BOXES = 8.0
"""Number of boxes at which the first two features have half their full weight."""
MOST_FOUND = 1.1
"""Greatest ratio of detections to expected ones that counts."""
MOVED, MOVED_RATIO = 0.6, -0.7
"""m from the mean of its places, less two standard deviations, above which a track has moved; its log-odds, as tracks jump between things."""
STANDS, STANDING_TIME = 0.2, 4.0
"""Probability that a person never moves, and mean time for which other people stand, s."""
ROUNDS = 6
"""Rounds of expectation and maximization."""


@dataclass(eq=False)
class _History:
    """A track so far.

    mean (2,) m over `places` ticks; time s; farthest: greatest distance from it less 2σ, m; ranks: sum over its boxes; boxes, expected: numbers.
    """

    mean: Array
    places: int = 0
    time: float = 0.0
    farthest: float = 0.0
    ranks: float = 0.0
    boxes: float = 0.0
    expected: float = 0.0


class StandingThings:
    """Log-odds that the confirmed trees of the global hypothesis are of things."""

    def __init__(self) -> None:
        self._history: dict[int, _History] = {}
        self._odds: dict[int, float] = {}

    def learn(self, seconds: float, tree: Ints, place: tuple[Array, Array], ranks: Array, expected: Array, alive: set[int]) -> None:
        """Take a tick `seconds` after the last, for trees (t,). Trees that are neither among them nor `alive` are forgotten.

        place: (t, 2) m, and its standard deviation (t,). ranks (t, V): of the confidence of the box that a tree takes in each view, 0 to 1,
        NaN for none. expected (t, V): detection rate in each view, 0 to 1, relative to people in full view.
        """
        (where, sigma), found = place, np.isfinite(ranks)
        # A box counts as half expected at least, which bounds the ratio of boxes to expected ones.
        due = np.where(found, np.maximum(expected, 0.5), expected).sum(axis=1)
        now = {one: self._history.get(one) or _History(where[k]) for k, one in enumerate(tree.tolist())}
        self._history = now | {one: track for one, track in self._history.items() if one in alive and one not in now}
        for k, track in enumerate(now.values()):
            track.time += seconds
            track.farthest = max(track.farthest, float(np.linalg.norm(where[k] - track.mean) - 2 * sigma[k]))
            track.places += 1
            track.mean = track.mean + (where[k] - track.mean) / track.places
            track.ranks += float(np.nansum(ranks[k]))
            track.boxes += float(found[k].sum())
            track.expected += float(due[k])
        self._odds = self._judged() if self._history else {}

    def _judged(self) -> dict[int, float]:
        columns = [(t.time, t.farthest, t.ranks, t.boxes, t.expected) for t in self._history.values()]
        time, farthest, ranks, boxes, expected = np.array(columns, dtype=np.float64).T
        moved, n = farthest > MOVED, len(time)
        figures = np.column_stack([ranks / np.maximum(boxes, 1.0), np.minimum(boxes / np.maximum(expected, 1.0), MOST_FOUND)])
        motion = np.where(moved, MOVED_RATIO, -np.log(STANDS + (1 - STANDS) * np.exp(-time / STANDING_TIME)))
        thing, odds = np.zeros(n), np.zeros(n)
        for _ in range(ROUNDS):
            person = np.where(moved, 1.0, WEIGHT_STANDING) * (1 - thing)
            usual = (WEIGHT_USUAL * USUAL + person @ figures) / (WEIGHT_USUAL + person.sum())
            share = (SHARE * PRIOR_TRACKS + thing.sum()) / (PRIOR_TRACKS + n)
            odds = (usual - figures) @ SLOPES * boxes / (boxes + LEAST_BOXES) + motion + logit(share)
            thing = expit(odds)
        return dict(zip(self._history, odds.tolist(), strict=True))

    def likely(self, tree: Ints, probability: float) -> Mask:
        """Which trees (n,) are of things with more than this probability."""
        return np.array([self._odds.get(one, -np.inf) for one in tree.tolist()], dtype=np.float64) > logit(probability)
