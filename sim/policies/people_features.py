"""What a choice of a robot tells of each person: the features of people for a learned policy, for any number of people and robots."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sim.placement.information import nats, predict_person, update_person
from sim.policies.planning import PeopleAhead, information_from
from sim.policies.policy import TeamKnowledge
from sim.policies.waypoints import WaypointFeatures
from tracker.geometry.compilation import njit

AHEAD = 3.0
"""Time ahead for which people are predicted, s: as long as a choice holds."""
PEOPLE_FEATURES = 5
"""Number of features of a person at a choice."""
NATS_SCALE, DISTANCE_SCALE = 6.0, 12.0
"""Nats and metres that are scaled to 1."""


Features = NDArray[np.float32]


def people_features(knowledge: TeamKnowledge, choices: NDArray[np.int64], bound_for: NDArray[np.int64]) -> NDArray[np.float32]:
    """Features (r, k, c, PEOPLE_FEATURES) of k people at the choices (r, c) of each robot. Choices and bound_for (r,) are nodes of the roadmap.

    While a robot chooses, the others are counted at the nodes that they are bound for.

    * 0: 1, so that rows of 0 are nobody. 1: nats about the person if the robot goes there. 2: of which it adds so many. 3: nats of now.
    * 4: distance of the person from the choice over 12 m.
    """
    ahead = PeopleAhead.of(knowledge, np.array([AHEAD]))
    used, rows = np.unique(np.concatenate([choices.ravel(), bound_for]), return_inverse=True)
    table = information_from(knowledge, used, ahead)[:, 0]
    out = np.zeros((len(choices), len(ahead.bounds), choices.shape[1], PEOPLE_FEATURES), dtype=np.float32)
    _fill(
        out,
        (ahead.bounds, ahead.feet[0], knowledge.place.roadmap.nodes[used]),
        table,
        (rows[: choices.size].reshape(choices.shape), rows[choices.size :]),
    )
    return out


class ChoiceFeatures:
    """The features of the choices of a team during an episode, and the nodes (r,) that the robots are bound for."""

    def __init__(self, knowledge: TeamKnowledge) -> None:
        self._waypoints = WaypointFeatures(knowledge)
        self.bound_for = knowledge.place.roadmap.nearest(knowledge.robots[:, :2])

    def update(self, knowledge: TeamKnowledge) -> tuple[Features, Features]:
        """Features (r, CHOICES, FEATURES) of the new choices, and (r, k, CHOICES, PEOPLE_FEATURES) of k known people at them.

        At most as many people are taken as there are, those known best first.
        """
        choices = self._waypoints.update(knowledge)
        people = people_features(knowledge, self._waypoints.goals, self.bound_for)
        if people.shape[1] > knowledge.config.people:
            best = np.argsort(-people[0, :, 0, 3], kind="stable")[: knowledge.config.people]
            people = people[:, best]
        return choices, people

    def chosen(self, choice: NDArray[np.int64]) -> NDArray[np.int64]:
        """The nodes (r,) of the choices (r,), which the robots are bound for from now on."""
        self.bound_for = self._waypoints.goals[np.arange(len(choice)), choice]
        return self.bound_for


@njit(cache=True)
def _fill(out, where, table, rows):  # type: ignore[no-untyped-def]
    (bounds, feet, nodes), (choices, bound_for), P = where, rows, np.empty((4, 4))
    for k in range(len(bounds)):
        P[:] = bounds[k]
        now = nats(P)
        predict_person(P, AHEAD)
        for r in range(len(choices)):
            others = np.zeros((2, 2))
            for q in range(len(choices)):
                if q != r:
                    others += 3.0 * table[bound_for[q], k]
            alone = P.copy()
            update_person(alone, others)
            for c in range(choices.shape[1]):
                after = alone.copy()
                update_person(after, 3.0 * table[choices[r, c], k])
                found, node = nats(after), nodes[choices[r, c]]
                out[r, k, c, 0], out[r, k, c, 1] = 1.0, found / NATS_SCALE
                out[r, k, c, 2], out[r, k, c, 3] = (found - nats(alone)) / NATS_SCALE, now / NATS_SCALE
                out[r, k, c, 4] = np.sqrt((node[0] - feet[k, 0]) ** 2 + (node[1] - feet[k, 1]) ** 2) / DISTANCE_SCALE
