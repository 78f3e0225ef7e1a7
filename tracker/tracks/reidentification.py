"""Re-identification: a new track continues a lost person where that is likelier than a new person.

A person who comes out from behind a wall after some seconds starts a new track, as the old one is deleted by then. Place, time and stature give the
likelihood that both are one person: the velocity decays while a person is lost, and the place diffuses.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.optimize import linear_sum_assignment

from tracker.geometry import Array, Mask
from tracker.tracks.tracks import Tracks, coasting_time
from tracker.types.ticks import ROUNDING

LOST_MISSES = 2.5
"""Revisits without a box after which a track counts as lost, so that a new track may continue it."""

STATURE_DRIFT = 0.02
"""m, standard deviation of the change of an apparent stature while a person is lost."""

RETURN_RATE = 0.2
"""Probability, per revisit, that a lost person reappears and is tracked again."""

DIFFUSION = 0.6
"""m²/s, growth of the variance of a lost person's place, per axis."""

MAX_STATURE_RATIO = 4.0
"""Greatest log-likelihood ratio of statures, by absolute value."""


class Appearance(NamedTuple):
    """Mean appearance (C, d) of a track in each camera, and the number `boxes` (C,) of which it is the mean; of t tracks (t, C, d) and (t, C)."""

    mean: Array
    boxes: Array

    def of(self, row: int) -> Appearance:
        """The appearance of one of several tracks."""
        return Appearance(self.mean[row], self.boxes[row])


@dataclass(frozen=True)
class ReidentificationParameters:
    """How people reappear."""

    memory: float = 8.0  # s after its last box for which a track may be re-identified


class NewTargetModel(NamedTuple):
    """New people: arrival_rate per square metre and revisit; mean and standard deviation of their stature, m."""

    arrival_rate: float
    stature: float
    stature_sigma: float


@dataclass(frozen=True, eq=False)
class _LastDetection:
    """A track at its last box: time s; state (5,) and covariance (5, 5) as in Tracks; its appearance."""

    time: float
    state: Array
    covariance: Array
    appearance: Appearance


class Reidentification:
    """Which tracks are of one person. `first_tree`: tree → the first tree of the same person, for trees that are not the first themselves."""

    def __init__(
        self,
        parameters: ReidentificationParameters,
        new_targets: NewTargetModel,
        same_person: Callable[[Appearance, Appearance], float],
    ) -> None:
        """same_person: log-likelihood ratio of two appearances being of one person."""
        self.parameters, self.new_targets = parameters, new_targets
        self.same_person = same_person
        self.first_tree: dict[int, int] = {}
        self._seen: dict[int, _LastDetection] = {}
        self._time = 0.0

    def step(self, time: float, tracks: Tracks, held: tuple[Mask, Mask], left: set[int], looks: Appearance) -> set[int]:
        """Process a tick at `time` s. Returns the lost trees that new trees continue, which should be deleted.

        held: which (t,) are confirmed, and which for the first time; left: trees of people outside all views, which are never
        re-identified. looks: appearances of the tracks.
        """
        self._time, (confirmed, fresh) = time, held
        for tree in left:
            self._seen.pop(tree, None)
        oldest = time - self.parameters.memory - ROUNDING
        self._seen = {tree: last for tree, last in self._seen.items() if last.time >= oldest}
        here = set(tracks.tree[tracks.misses < LOST_MISSES].tolist())
        lost, new = [tree for tree in self._seen if tree not in here], np.flatnonzero(fresh)
        # An unpaired new track is a new person, and an unpaired lost track stays lost: ratio 0.
        ratio = np.array([[self._ratio(self._seen[tree], tracks, k, looks) for tree in lost] for k in new.tolist()]).reshape(len(new), len(lost))
        rows, columns = linear_sum_assignment(np.maximum(ratio, 0.0), maximize=True)
        ended = set()
        for i, j in zip(rows.tolist(), columns.tolist(), strict=True):
            if ratio[i, j] > 0:
                self.first_tree[int(tracks.tree[new[i]])] = self.first_tree.get(lost[j], lost[j])
                del self._seen[lost[j]]
                ended.add(lost[j])
        for k in np.flatnonzero(confirmed & (tracks.misses == 0)):
            self._seen[int(tracks.tree[k])] = _LastDetection(time, tracks.state[k], tracks.covariance[k], looks.of(int(k)))
        return ended

    def _ratio(self, last: _LastDetection, tracks: Tracks, row: int, looks: Appearance) -> float:
        """log-likelihood ratio of the track in `row` being the lost one, against a new person."""
        gap = self._time - last.time
        F = np.hstack([np.eye(2), coasting_time(gap) * np.eye(2), np.zeros((2, 1))])
        S = F @ last.covariance @ F.T + tracks.covariance[row, :2, :2] + DIFFUSION * gap * np.eye(2)
        r = tracks.state[row, :2] - F @ last.state
        density = -0.5 * (r @ np.linalg.solve(S, r) + np.log((2 * np.pi) ** 2 * np.linalg.det(S)))
        alike = self.same_person(last.appearance, looks.of(row))
        return float(density + alike + self._stature_ratio(last, tracks, row) + np.log(RETURN_RATE / self.new_targets.arrival_rate))

    def _stature_ratio(self, last: _LastDetection, tracks: Tracks, row: int) -> float:
        """log-likelihood ratio of the measured stature of the track in `row` being that of the lost track, against that of a new person."""
        usual, variance = self.new_targets.stature, self.new_targets.stature_sigma**2
        mean, spread = tracks.state[row, 4], tracks.covariance[row, 4, 4]
        if spread > 0.9 * variance:
            return 0.0
        # The prior, which both share, is taken out of the estimate: what is left is the measurement.
        noise = 1 / (1 / spread - 1 / variance)
        measured = noise * (mean / spread - usual / variance)
        same, other = (
            -0.5 * ((measured - m) ** 2 / (noise + v) + np.log(noise + v))
            for m, v in ((last.state[4], last.covariance[4, 4] + STATURE_DRIFT**2), (usual, variance))
        )
        return float(np.clip(same - other, -MAX_STATURE_RATIO, MAX_STATURE_RATIO))

    def relabelled(self, people: Tracks) -> Tracks:
        """The tracks with the first tree of each person; of two tracks of one person, only the later is kept."""
        first = np.array([self.first_tree.get(tree, tree) for tree in people.tree.tolist()], dtype=np.int64)
        later = (first[:, None] == first) & (people.tree[:, None] < people.tree)
        kept = ~later.any(axis=1)
        return replace(people, tree=first).select(kept)
