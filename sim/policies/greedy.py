"""The greedy policy: each robot makes the next move with the largest information gain."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from sim.placement.beliefs import AZIMUTH_SIGMA, ELEVATION_SIGMA, LOST_SIGMA, POSITION_SIGMA
from sim.placement.map import CHEST_HEIGHT, PlacementMap
from sim.placement.visibility import line_of_sight
from sim.policies.policy import TeamKnowledge, waypoint_action
from sim.policies.waypoints import RECOVERY_TIME, UnseenMap
from tracker.geometry import Array
from tracker.geometry.compilation import njit

LOOKAHEAD = 1.5
"""Time ahead for which the positions of people are predicted, s."""
MAX_PATH, PATH_DISCOUNT = 6.0, 7.0
"""Path length to the farthest node considered, and path length that discounts a gain to 1/e, m."""
SWITCHING_GAIN = 0.05
"""Advantage over the present goal that another node needs, nats."""
ROUNDS = 2
"""Rounds in which the robots choose in turn, each given the choices of the others."""
REPEATED_VIEW_GAIN = (1.0, 0.4, 0.1)
"""Relative gain of observing an unknown person whom no, one or two other robots observe, too."""
SAMPLE_OFFSETS = np.array([(0.0, 0.0), (1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0)])
"""Sample positions of a person, in standard deviations along the axes."""


class Greedy:
    """Each robot goes to the nearby node with the largest information gain of the team.

    The gain is the decrease of log det of the covariances of known people, plus the expected gain of finding unknown people. Those are expected
    where no robot looked recently (UnseenMap).
    """

    action = "waypoint"

    def begin(self, knowledge: TeamKnowledge, rng: np.random.Generator) -> None:
        place = knowledge.place
        self._goals = place.roadmap.nearest(knowledge.robots[:, :2])
        self._unseen = UnseenMap(place)

    def act(self, knowledge: TeamKnowledge) -> Array:
        place = knowledge.place
        visible = place.visible_from_nodes(knowledge.config.reach)
        current = self._unseen.update(knowledge, knowledge.config.period / RECOVERY_TIME)
        unknown = max(knowledge.config.people - len(knowledge.position), 0)
        # An unknown person gains from the standard deviation LOST_SIGMA to that of one measurement.
        unknown_gain = unknown * 2.0 * math.log(LOST_SIGMA / 0.3) / len(self._unseen.density)
        points, spread = _predicted_people(knowledge)
        path_length = place.roadmap.distance[current]
        reachable = [np.flatnonzero(row <= MAX_PATH) for row in path_length]
        gains = [_measurement_information(place, numbers, points, knowledge.config.reach) for numbers in reachable]
        chosen = [int(np.argmin(np.abs(numbers - h))) for numbers, h in zip(reachable, current, strict=True)]
        for k, goal in enumerate(self._goals):
            if goal in reachable[k]:
                chosen[k] = int(np.searchsorted(reachable[k], goal))
        for _ in range(ROUNDS):
            for k in range(len(current)):
                others = sum((gains[q][chosen[q]] for q in range(len(current)) if q != k), np.zeros_like(gains[k][0]))
                other_nodes = [reachable[q][chosen[q]] for q in range(len(current)) if q != k]
                views = visible[other_nodes].sum(axis=0)
                weight = np.choose(np.minimum(views, 2), REPEATED_VIEW_GAIN)
                value = _information_gain(spread, others, gains[k]) + unknown_gain * (visible[reachable[k]] @ (self._unseen.density * weight))
                gap = place.roadmap.nodes[reachable[k]][:, None] - place.roadmap.nodes[other_nodes]
                too_close = np.linalg.norm(gap, axis=2).min(axis=1, initial=9.0) < 1.2
                value = (value - value[chosen[k]]) * np.exp(-path_length[k][reachable[k]] / PATH_DISCOUNT) - 1e3 * too_close
                value[chosen[k]] = SWITCHING_GAIN
                chosen[k] = int(np.argmax(value))
        self._goals = np.array([numbers[c] for numbers, c in zip(reachable, chosen, strict=True)])
        return waypoint_action(place, self._goals)


def _predicted_people(knowledge: TeamKnowledge) -> tuple[Array, Array]:
    """Sample positions (k, 5, 2) m of people LOOKAHEAD s from now, and covariances (k, 2, 2) m², inflated by the uncertainty of a step."""
    position = knowledge.position + LOOKAHEAD * 0.5 * knowledge.velocity
    spread = knowledge.covariance + np.eye(2) * (0.3**2 + 0.6 * LOOKAHEAD**3 / 3)
    root = np.linalg.cholesky(spread) if len(spread) else np.zeros((0, 2, 2))
    return position[:, None] + np.einsum("kij,cj->kci", root, SAMPLE_OFFSETS), spread


def _measurement_information(place: PlacementMap, numbers: NDArray[np.int64], points: Array, reach: float) -> Array:
    """Information matrices (n, k, 2, 2) in 1/m² of a measurement from each of these nodes of each person at points (k, 5, 2) m."""
    flat = points.reshape(-1, 2)
    goals = np.column_stack([flat, place.floor_at(flat) + CHEST_HEIGHT])
    share = np.zeros((len(numbers), len(points)))
    if len(points):
        for n, number in enumerate(numbers):
            share[n] = line_of_sight(place.elevation, place.node_cameras[number], goals).reshape(len(points), -1).mean(axis=1)
    return _information_matrices(place.roadmap.nodes[numbers], points[:, 0], share, reach)


@njit(cache=True)
def _information_matrices(places, people, share, reach):  # type: ignore[no-untyped-def]
    out = np.zeros((len(places), len(people), 2, 2))
    for n in range(len(places)):
        for k in range(len(people)):
            dx, dy = places[n, 0] - people[k, 0], places[n, 1] - people[k, 1]
            r = math.sqrt(dx * dx + dy * dy) + 1e-9
            if r > reach or share[n, k] <= 0:
                continue
            radial = share[n, k] / ((ELEVATION_SIGMA * (r * r + 2.25) / 1.5) ** 2 + POSITION_SIGMA**2)
            tangential = share[n, k] / ((AZIMUTH_SIGMA * r) ** 2 + POSITION_SIGMA**2)
            c, s = dx / r, dy / r
            out[n, k, 0, 0], out[n, k, 1, 1] = radial * c * c + tangential * s * s, radial * s * s + tangential * c * c
            out[n, k, 0, 1] = out[n, k, 1, 0] = (radial - tangential) * c * s
    return out


@njit(cache=True)
def _information_gain(spread, others, gains):  # type: ignore[no-untyped-def]
    """Information gain (n,) in nats: ½ log det(1 + P Λ), summed over people of covariance P.

    Λ is the information of the other robots (k, 2, 2) plus that of one more node (n, k, 2, 2).
    """
    out = np.zeros(len(gains))
    for n in range(len(gains)):
        for k in range(len(spread)):
            L, P = others[k] + gains[n, k], spread[k]
            a, b = 1.0 + P[0, 0] * L[0, 0] + P[0, 1] * L[1, 0], P[0, 0] * L[0, 1] + P[0, 1] * L[1, 1]
            c, d = P[1, 0] * L[0, 0] + P[1, 1] * L[1, 0], 1.0 + P[1, 0] * L[0, 1] + P[1, 1] * L[1, 1]
            out[n] += 0.5 * math.log(max(a * d - b * c, 1e-12))
    return out
