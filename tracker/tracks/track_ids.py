"""Ids of people as they are reported: the id of the tree, and a new one for who left the area and came back."""

from __future__ import annotations

import numpy as np

from tracker.geometry import Array, Ints
from tracker.tracks.tracks import Tracks
from tracker.types import Setup

BEYOND = 1.0
"""m outside the area at which somebody has left it: places are wrong by half of that, so that who walks along its edge seems to be in and out."""
GONE = 3.0
"""s outside the area after which somebody has left it, however near they are."""


class TrackIds:
    """Which id each tree was given. Ids count from 1 and are never used again."""

    def __init__(self, setup: Setup) -> None:
        self.setup = setup
        self._name: dict[int, int] = {}
        self._since: dict[int, int] = {}
        self._next, self._tick = 1, 0

    def report(self, people: Tracks) -> tuple[Ints, Array, Array]:
        """Ids (k,), places on the ground (k, 3) m and covariances (k, 3, 3) of the people in the area."""
        self._tick += 1
        beyond = self.setup.distance_beyond(people.state)
        for tree, far in zip(people.tree.tolist(), beyond.tolist(), strict=True):
            if far > 0:
                self._since.setdefault(tree, self._tick)
            # Time goes on while nobody sees them, too.
            if far >= BEYOND or (self._tick - self._since.get(tree, self._tick)) * self.setup.period > GONE:
                self._name.pop(tree, None)
            if far <= 0:
                self._since.pop(tree, None)
                if tree not in self._name:
                    self._name[tree], self._next = self._next, self._next + 1
        chosen = people.select(beyond <= 0)
        covariance = np.zeros((len(chosen), 3, 3))
        covariance[:, :2, :2] = chosen.covariance[:, :2, :2]
        ids = np.array([self._name[tree] for tree in chosen.tree.tolist()], dtype=np.int64)
        return ids, np.column_stack([chosen.state[:, :2], self.setup.ground.height_at(chosen.state[:, :2])]), covariance
