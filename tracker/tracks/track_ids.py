"""Track ids as they are reported: one for each tree, and a new one for a person who leaves the area and comes back."""

from __future__ import annotations

import numpy as np

from tracker.geometry import Array, Ints
from tracker.tracks.tracks import Tracks
from tracker.types import Setup

EXIT_DISTANCE = 1.0
"""m beyond the area from which a person has left it. Places err by half of that, so that a person on the edge keeps the id."""
EXIT_TIME = 3.0
"""s outside the area after which a person has left it, at any distance."""


class TrackIds:
    """The id of each tree. Ids count from 1 and are never used again."""

    def __init__(self, setup: Setup) -> None:
        self.setup = setup
        self._ids: dict[int, int] = {}
        self._outside_since: dict[int, int] = {}  # tree → tick
        self._next, self._tick = 1, 0

    def report(self, people: Tracks) -> tuple[Ints, Array, Array]:
        """Ids (k,), places on the ground (k, 3) m and covariances (k, 3, 3) of the people in the area."""
        self._tick += 1
        beyond = self.setup.distance_beyond(people.state)
        for tree, far in zip(people.tree.tolist(), beyond.tolist(), strict=True):
            if far > 0:
                self._outside_since.setdefault(tree, self._tick)
            # Ticks without the track count, too.
            if far >= EXIT_DISTANCE or (self._tick - self._outside_since.get(tree, self._tick)) * self.setup.period > EXIT_TIME:
                self._ids.pop(tree, None)
            if far <= 0:
                self._outside_since.pop(tree, None)
                if tree not in self._ids:
                    self._ids[tree], self._next = self._next, self._next + 1
        chosen = people.select(beyond <= 0)
        covariance = np.zeros((len(chosen), 3, 3))
        covariance[:, :2, :2] = chosen.covariance[:, :2, :2]
        ids = np.array([self._ids[tree] for tree in chosen.tree.tolist()], dtype=np.int64)
        return ids, np.column_stack([chosen.state[:, :2], self.setup.ground.height_at(chosen.state[:, :2])]), covariance
