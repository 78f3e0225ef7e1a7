"""Ids of people as they are reported: the id of the tree, and a new one for who left the area and came back."""

from __future__ import annotations

import numpy as np

from tracker.geometry import Array
from tracker.measurements import Ints, Setup
from tracker.trees import Tracks


class Names:
    """Which id each tree was given. Ids count from 1 and are never used again."""

    def __init__(self, setup: Setup) -> None:
        self.setup = setup
        self._name: dict[int, int] = {}
        self._outside: dict[int, int] = {}
        self._next = 1

    def report(self, people: Tracks) -> tuple[Ints, Array, Array]:
        """Ids (k,), places on the ground (k, 3) m and covariances (k, 3, 3) of the people in the area."""
        place = people.state[:, :2]
        inside = np.ones(len(people), dtype=bool)
        if self.setup.area is not None:
            inside = ((place >= self.setup.area[0]) & (place <= self.setup.area[1])).all(axis=1)
        for tree, here in zip(people.tree.tolist(), inside, strict=True):
            self._outside[tree] = 0 if here else self._outside.get(tree, 0) + 1
            if tree not in self._name or (self._outside[tree] == 2 and self._name[tree]):
                # 0 marks a tree that has to be named anew when it comes in.
                self._name[tree] = 0
            if here and not self._name[tree]:
                self._name[tree], self._next = self._next, self._next + 1
        chosen = people.select(inside)
        covariance = np.zeros((len(chosen), 3, 3))
        covariance[:, :2, :2] = chosen.covariance[:, :2, :2]
        ids = np.array([self._name[tree] for tree in chosen.tree.tolist()], dtype=np.int64)
        return ids, np.column_stack([chosen.state[:, :2], self.setup.ground.height_at(chosen.state[:, :2])]), covariance
