"""The waypoints between which a learned policy chooses, their features, and a map of where unseen people are expected.

The features have the same shape for any number of robots and people.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sim.placement.map import PlacementMap, kept_with_map
from sim.placement.roadmap import nearest
from sim.policies.policy import TeamKnowledge
from tracker.geometry import Array

RECOVERY_TIME = 12.0
"""Time constant with which the expected number of unseen people recovers after an observation, s."""

HOLD = 2
"""Decisions for which a choice holds: 1 s."""

DISTANCES, DIRECTIONS = (2.5, 5.0), 8
"""Distances of the waypoints from the robot (m), and number of directions."""

CHOICES = 1 + len(DISTANCES) * DIRECTIONS
"""Number of choices: to stay, or one of the waypoints."""

POINT_FEATURES = 9
"""Number of features of a choice that WaypointFeatures gives."""

LOOKAHEAD = 0.75
"""Time ahead for which the positions of people are predicted, s."""

MIN_GAP = 1.2
"""Distance between a waypoint and another robot below which it counts as too close, m."""


class UnseenMap:
    """The expected density of unseen people: density (k,), at each of the map's `walkable_points`.

    It is the map's `traffic` at first and long after an observation, and 0 directly after one.
    """

    def __init__(self, place: PlacementMap) -> None:
        self.density = place.traffic.copy()

    def update(self, knowledge: TeamKnowledge, share: float) -> NDArray[np.int64]:
        """Update the density with the robots' fields of view, and return the nearest nodes (r,) of the roadmap.

        share: fraction of the difference to `traffic` that has recovered since the last update.
        """
        place = knowledge.place
        here = place.roadmap.nearest(knowledge.robots[:, :2])
        self.density += (place.traffic - self.density) * share
        self.density[place.visible_from_nodes(knowledge.config.reach)[here].any(axis=0)] = 0.0
        return here


@kept_with_map
def choices_of(place: PlacementMap) -> tuple[NDArray[np.int64], Array]:
    """The choices at each of the n nodes of a map's roadmap, cached: nodes (n, CHOICES), the first its own, and path lengths to them, m."""
    here = place.roadmap.nodes
    angle = np.arange(DIRECTIONS) * 2 * np.pi / DIRECTIONS
    around = np.concatenate([r * np.column_stack([np.cos(angle), np.sin(angle)]) for r in DISTANCES])
    points = here[:, None] + np.concatenate([np.zeros((1, 2)), around])
    goals = np.stack([place.roadmap.nearest(row) for row in points])
    return goals, np.take_along_axis(place.roadmap.distance, goals, axis=1)


class WaypointFeatures:
    """The features of the choices of a team during an episode. goals (r, CHOICES): nodes of the roadmap."""

    def __init__(self, knowledge: TeamKnowledge) -> None:
        self._unseen = UnseenMap(knowledge.place)
        self.goals = np.zeros((0, CHOICES), dtype=np.int64)

    def update(self, knowledge: TeamKnowledge) -> NDArray[np.float32]:
        """Features (r, CHOICES, POINT_FEATURES) of each robot and each of its new `goals`, mostly in [−1, 1].

        * 0 to 2: share of people who are known and visible from the goal, and whom no, one, or several other robots see.
        * 3 to 5: expected share of unknown people, divided in the same way.
        * 6: path length to the goal over 5 m. 7: whether another robot is too close to the goal. 8: 1 for the choice to stay.
        """
        place, config = knowledge.place, knowledge.config
        visible, (choices, path_length) = place.visible_from_nodes(config.reach), choices_of(place)
        here = self._unseen.update(knowledge, float(1.0 - np.exp(-config.period * HOLD / RECOVERY_TIME)))
        self.goals = choices[here]
        count = max(config.people, 1)
        unknown = max(config.people - len(knowledge.position), 0) / count
        where = nearest(knowledge.position + LOOKAHEAD * knowledge.velocity, place.walkable_points[:, :2])
        weight = np.bincount(where, minlength=len(self._unseen.density)) / count
        out = np.zeros((*self.goals.shape, POINT_FEATURES), dtype=np.float32)
        views = visible[here].sum(axis=0)
        for k, goals in enumerate(self.goals):
            others = np.minimum(views - visible[here[k]], 2)
            for n in range(3):
                density = np.stack([weight * (others == n), unknown * self._unseen.density * (others == n) / place.traffic.sum()], axis=1)
                out[k, :, [n, 3 + n]] = (visible[goals] @ density).T
            gap = place.roadmap.nodes[goals][:, None] - np.delete(knowledge.robots[:, :2], k, axis=0)
            out[k, :, 7] = np.linalg.norm(gap, axis=2).min(axis=1, initial=9.0) < MIN_GAP
        out[..., 6] = path_length[here] / DISTANCES[-1]
        out[:, 0, 8] = 1.0
        return out
