"""Where somebody may be whom the team does not know: wherever people walk and nobody looked for a while.

What a robot that learns where to go chooses between, and what it knows of each choice: the same for any number of robots and people.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from sim.placement.map import KEPT, PlacementMap
from sim.placement.roadmap import nearest
from sim.policies.policy import Briefing
from tracker.geometry import Array

FADING = 12.0
"""s after which nobody knows any more that a place was empty."""


class UnseenMap:
    """What a team remembers of having looked: left (k,), how much people may be unseen at each of the map's `where_people_may_be`.

    At first, and long after a look, that is the map's `traffic`; nothing right after it.
    """

    def __init__(self, place: PlacementMap) -> None:
        self.left = place.traffic.copy()

    def look(self, briefing: Briefing, share: float) -> NDArray[np.int64]:
        """(r,): the places of the roads at which the robots are. share: how much comes back of what was lost, since the last look."""
        place = briefing.place
        here = place.roads.nearest(briefing.robots[:, :2])
        self.left += (place.traffic - self.left) * share
        self.left[place.sees(briefing.config.reach)[here].any(axis=0)] = 0.0
        return here


HOLD = 6
"""Decisions for which a choice holds: 3 s, in which a robot gets somewhere."""

STEPS, WAYS = (2.5, 5.0), 8
"""m to the places that a robot chooses between, in so many directions; the other choice is to stay."""

CHOICES = 1 + len(STEPS) * WAYS

PARTS = 9
"""Numbers that tell of a choice."""

AHEAD = 0.75
"""s: people are met where they will be by then, if they go on."""

CROWDED = 1.2
"""m that robots keep from each other's goals."""


@dataclass(frozen=True, eq=False)
class Choices:
    """Of a map: goals (n, CHOICES), the places that a robot at each of n places of the roads chooses between, the first of them its own;
    way (n, CHOICES) m along the roads to them."""

    goals: NDArray[np.int64]
    way: Array


@lru_cache(maxsize=KEPT)
def choices_of(place: PlacementMap) -> Choices:
    """Built once a map."""
    here = place.roads.places
    angle = np.arange(WAYS) * 2 * np.pi / WAYS
    around = np.concatenate([r * np.column_stack([np.cos(angle), np.sin(angle)]) for r in STEPS])
    points = here[:, None] + np.concatenate([np.zeros((1, 2)), around])
    goals = np.stack([place.roads.nearest(row) for row in points])
    return Choices(goals, np.take_along_axis(place.roads.distance, goals, axis=1))


class Watch:
    """What a team remembers in an episode: where nobody looked for a while, as a share of how much people are there."""

    def __init__(self, briefing: Briefing) -> None:
        self._hope = UnseenMap(briefing.place)
        self.goals = np.zeros((0, CHOICES), dtype=np.int64)

    def look(self, briefing: Briefing) -> NDArray[np.float32]:
        """(r, CHOICES, PARTS) in [−1, 1] or a little more, for each robot and each of its `goals` (r, CHOICES), places of the roads.

        Seen from there, if nobody is between: people known (a share of all), by whether none, one or more of the other robots sees them;
        of the rest, where others may be, likewise; the way there over 5 m; whether another robot is too near to it; and 1 for staying.
        """
        place, config = briefing.place, briefing.config
        sees, choices = place.sees(config.reach), choices_of(place)
        here = self._hope.look(briefing, float(1.0 - np.exp(-config.period * HOLD / FADING)))
        self.goals = choices.goals[here]
        count = max(config.people, 1)
        unknown = max(config.people - len(briefing.position), 0) / count
        where = nearest(briefing.position + AHEAD * briefing.velocity, place.where_people_may_be[:, :2])
        weight = np.bincount(where, minlength=len(self._hope.left)) / count
        out = np.zeros((*self.goals.shape, PARTS), dtype=np.float32)
        views = sees[here].sum(axis=0)
        for k, goals in enumerate(self.goals):
            others = np.minimum(views - sees[here[k]], 2)
            for n in range(3):
                told = np.stack([weight * (others == n), unknown * self._hope.left * (others == n) / place.traffic.sum()], axis=1)
                out[k, :, [n, 3 + n]] = (sees[goals] @ told).T
            gap = place.roads.places[goals][:, None] - np.delete(briefing.robots[:, :2], k, axis=0)
            out[k, :, 7] = np.linalg.norm(gap, axis=2).min(axis=1, initial=9.0) < CROWDED
        out[..., 6] = choices.way[here] / STEPS[-1]
        out[:, 0, 8] = 1.0
        return out
