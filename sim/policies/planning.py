"""Policies that plan by expected information: greedy, which evaluates the next goal, and predictive, which evaluates whole paths.

Both maximize the environment's information (sim.placement.information) about predicted people. Each robot in turn chooses the goal with the most
expected information of the team. Predictive control follows Mayne et al. 2000, Constrained model predictive control: stability and optimality.
Only the first decision of the best path is executed, and the next decision plans anew.
Features of people for a learned policy give the information that a robot's choice adds about each person.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.placement.config import FRAMES_PER_DECISION
from sim.placement.episode import detector_row
from sim.placement.information import (
    LOST_SIGMA,
    add_view,
    nats,
    predict_person,
    started_robots,
    update_person,
)
from sim.placement.map import CAMERA_HEIGHT, CHEST_HEIGHT, PlacementMap
from sim.placement.visibility import sees
from sim.policies.policy import TeamKnowledge, waypoint_action
from sim.policies.waypoints import RECOVERY_TIME, UnseenMap, WaypointFeatures
from tracker.geometry import Array, Mask
from tracker.geometry.compilation import njit

AHEAD = 3.0
"""Prediction time for people, s: the time for which a choice holds."""
PEOPLE_FEATURES = 5
"""Number of features of a person at a choice."""
NATS_SCALE, DISTANCE_SCALE = 6.0, 12.0
"""Nats and metres that are scaled to 1."""


Features = NDArray[np.float32]
STATURE = 1.72
"""Assumed stature of people, which policies do not know, m."""
KEEPS_WALKING = 4.0
"""Time constant with which the predicted velocity of a person decays, s."""
TRACKED_VELOCITY_SIGMA = 0.4
"""Standard deviation of the velocity of a tracked person, m/s."""
MAX_PATH, PATH_DISCOUNT = 6.0, 7.0
"""Path length to the farthest goal considered, and path length that discounts a gain of greedy to 1/e, m."""
SWITCHING_GAIN = 0.05
"""Advantage over the present goal that another goal needs, nats."""
MOST_GOALS = 48
"""Largest number of goals that predictive compares per robot; longer lists are subsampled evenly."""
DRIVING_SPEED = 1.2
"""Assumed speed along a planned path, m/s. With a lower speed, paths end before the informative places."""
ROUNDS = 2
"""Rounds in which the robots choose in turn, each given the choices of the others."""
REPEATED_VIEW_GAIN = (1.0, 0.4, 0.1)
"""Relative gain of a view of an unknown person whom no, one or two other robots also see."""
FOUND_SIGMA = 0.3
"""Standard deviation of the place of a person after the first box, m."""
CLOSE = 1.2
"""Distance between the goals of two robots that is too close, m."""


def people_features(knowledge: TeamKnowledge, choices: NDArray[np.int64], bound_for: NDArray[np.int64]) -> NDArray[np.float32]:
    """Features (r, k, c, PEOPLE_FEATURES) of k people at the choices (r, c) of each robot. Choices and bound_for (r,) are nodes of the roadmap.

    While a robot chooses, the others count as being at their nodes in bound_for.

    * 0: 1, while padding rows are 0. 1 to 3, over 6 nats: information if the robot goes there; the robot's share of it; information now.
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

        If there are more tracks than people, only the best known tracks are kept.
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
                    others += FRAMES_PER_DECISION * table[bound_for[q], k]
            alone = P.copy()
            update_person(alone, others)
            for c in range(choices.shape[1]):
                after = alone.copy()
                update_person(after, FRAMES_PER_DECISION * table[choices[r, c], k])
                found, node = nats(after), nodes[choices[r, c]]
                out[r, k, c, 0], out[r, k, c, 1] = 1.0, found / NATS_SCALE
                out[r, k, c, 2], out[r, k, c, 3] = (found - nats(alone)) / NATS_SCALE, now / NATS_SCALE
                out[r, k, c, 4] = np.sqrt((node[0] - feet[k, 0]) ** 2 + (node[1] - feet[k, 1]) ** 2) / DISTANCE_SCALE


@dataclass(frozen=True, eq=False)
class PeopleAhead:
    """k people at T times ahead: times (T,) s, feet (T, k, 2) m, and current bounds (k, 4, 4)."""

    times: Array
    feet: Array
    bounds: Array

    @staticmethod
    def of(knowledge: TeamKnowledge, times: Array) -> PeopleAhead:
        """Predict people with velocities that decay with the time constant KEEPS_WALKING."""
        ahead = KEEPS_WALKING * (1.0 - np.exp(-times / KEEPS_WALKING))
        bounds = np.zeros((len(knowledge.position), 4, 4))
        bounds[:, :2, :2] = knowledge.covariance
        bounds[:, 2, 2] = bounds[:, 3, 3] = TRACKED_VELOCITY_SIGMA**2
        return PeopleAhead(times, knowledge.position + ahead[:, None, None] * knowledge.velocity, bounds)


def information_from(knowledge: TeamKnowledge, nodes: NDArray[np.int64], forecast: PeopleAhead) -> Array:
    """Expected information (n, T, k, 2, 2), 1/m², of one frame from each of these nodes about each person at each time."""
    place, config = knowledge.place, knowledge.config
    cameras = place.node_cameras[nodes]
    flat = forecast.feet.reshape(-1, 2)
    chests = np.column_stack([flat, place.floor_at(flat) + CHEST_HEIGHT]).reshape(*forecast.feet.shape[:2], 3)
    return np.asarray(
        _information_from(place.scene.top, place.scene.frame, (cameras, chests), (detector_row(config), started_robots(1)[0], config.reach))
    )


class Greedy:
    """Each robot goes to the nearby goal from which the team expects the most information about people, discounted by the path.

    Unknown people are expected where no robot looked recently (UnseenMap).
    """

    action = "waypoint"
    times = np.array([1.5])

    def begin(self, knowledge: TeamKnowledge, rng: np.random.Generator) -> None:
        self._goals = knowledge.place.roadmap.nearest(knowledge.robots[:, :2])
        self._unseen = UnseenMap(knowledge.place)

    def act(self, knowledge: TeamKnowledge) -> Array:
        place = knowledge.place
        here = self._unseen.update(knowledge, knowledge.config.period / RECOVERY_TIME)
        forecast = PeopleAhead.of(knowledge, self.times)
        goals = [self._candidates(place, int(node), int(goal)) for node, goal in zip(here, self._goals, strict=True)]
        ways = [self._ways(place, int(node), row) for node, row in zip(here, goals, strict=True)]
        used, numbered = np.unique(np.concatenate([way.ravel() for way in ways]), return_inverse=True)
        numbers = [part.reshape(way.shape) for part, way in zip(np.split(numbered, np.cumsum([way.size for way in ways])[:-1]), ways, strict=True)]
        table = information_from(knowledge, used, forecast)
        visible = place.visible_from_nodes(knowledge.config.reach)[used]
        unknown = max(knowledge.config.people - len(knowledge.position), 0) * 2.0 * math.log(LOST_SIGMA / FOUND_SIGMA) / len(self._unseen.density)
        chosen = [0] * len(here)
        for _ in range(ROUNDS):
            for k in range(len(here)):
                others = [numbers[q][chosen[q]] for q in range(len(here)) if q != k]
                value = team_values(forecast, table, numbers[k], others)
                value += unknown * self._unknown_found(visible, numbers[k], others)
                chosen[k] = self._best(place, value, goals[k], place.roadmap.distance[here[k]][goals[k]],
                                       [goals[q][chosen[q]] for q in range(len(here)) if q != k])  # fmt: skip
        self._goals = np.array([row[c] for row, c in zip(goals, chosen, strict=True)])
        return waypoint_action(place, self._goals)

    def _candidates(self, place: PlacementMap, node: int, goal: int) -> NDArray[np.int64]:
        """The goals (n,) that a robot at a node compares; the present one is first."""
        near = np.flatnonzero(place.roadmap.distance[node] <= MAX_PATH)
        return np.concatenate([[goal], near[near != goal]])

    def _ways(self, place: PlacementMap, node: int, goals: NDArray[np.int64]) -> NDArray[np.int64]:
        """Assumed nodes (n, T) of a robot at each time: here always the goal."""
        return np.repeat(goals[:, None], len(self.times), axis=1)

    def _unknown_found(self, visible: Mask, numbers: NDArray[np.int64], others: list[NDArray[np.int64]]) -> Array:
        """Weighted expected number (n,) of unknown people seen at the end of each way."""
        views = sum((visible[way[-1]].astype(np.int64) for way in others), np.zeros(visible.shape[1], dtype=np.int64))
        return np.asarray(visible[numbers[:, -1]] @ (self._unseen.density * np.take(REPEATED_VIEW_GAIN, np.minimum(views, 2))))

    def _best(self, place: PlacementMap, value: Array, goals: NDArray[np.int64], path: Array, others: list[int]) -> int:
        """Index of the goal with the highest value. Another goal replaces the present goal only if it is better by SWITCHING_GAIN."""
        gap = np.linalg.norm(place.roadmap.nodes[goals][:, None] - place.roadmap.nodes[np.array(others, dtype=np.int64)], axis=2)
        gain = self._discounted(value - value[0], path) - 1e3 * (gap.min(axis=1, initial=9.0) < CLOSE)
        gain[0] += SWITCHING_GAIN
        return int(np.argmax(gain))

    def _discounted(self, gain: Array, path: Array) -> Array:
        return np.asarray(gain * np.exp(-path / PATH_DISCOUNT))


class Predictive(Greedy):
    """Model predictive control: each robot compares paths over the next 7.5 s, during which people move."""

    times = np.arange(1.0, 6.0) * 1.5

    def _candidates(self, place: PlacementMap, node: int, goal: int) -> NDArray[np.int64]:
        found = super()._candidates(place, node, goal)
        return np.concatenate([found[:1], found[1:][:: max(1, math.ceil((len(found) - 1) / MOST_GOALS))]])

    def _ways(self, place: PlacementMap, node: int, goals: NDArray[np.int64]) -> NDArray[np.int64]:
        return np.asarray(_nodes_at(node, goals, place.roadmap.next_node, place.roadmap.distance[node], self.times * DRIVING_SPEED))

    def _discounted(self, gain: Array, path: Array) -> Array:
        return gain


def team_values(forecast: PeopleAhead, table: Array, ways: NDArray[np.int64], others: list[NDArray[np.int64]]) -> Array:
    """Expected information (n,), nats, summed over people and averaged over times, if one robot takes each of its ways (n, T).

    table: information_from the nodes. ways: rows of table. others: the ways (T,) of the other robots.
    """
    fixed = np.zeros(table.shape[1:])
    for way in others:
        fixed += table[way, np.arange(len(forecast.times))]
    return np.asarray(_team_values(forecast.bounds, np.diff(forecast.times, prepend=0.0), table, ways, fixed))


@njit(cache=True)
def _team_values(bounds, steps, table, ways, fixed):  # type: ignore[no-untyped-def]
    out, P = np.zeros(len(ways)), np.empty((4, 4))
    for w in range(len(ways)):
        for k in range(len(bounds)):
            P[:] = bounds[k]
            for t in range(len(steps)):
                predict_person(P, steps[t])
                # All frames of a decision count, as in the reward.
                update_person(P, FRAMES_PER_DECISION * (fixed[t, k] + table[ways[w, t], t, k]))
                out[w] += nats(P) / len(steps)
    return out


@njit(cache=True)
def _information_from(top, frame, lines, settings):  # type: ignore[no-untyped-def]
    """`information_from` between cameras (n, 3) m and chests (T, k, 3) m over a map's columns. settings: detector, bound of a robot, reach m."""
    (cameras, chests), (detector, robot, reach) = lines, settings
    out = np.zeros((len(cameras), chests.shape[0], chests.shape[1], 2, 2))
    for n in range(len(cameras)):
        for t in range(chests.shape[0]):
            for k in range(chests.shape[1]):
                dx, dy = chests[t, k, 0] - cameras[n, 0], chests[t, k, 1] - cameras[n, 1]
                r = math.sqrt(dx * dx + dy * dy) + 1e-9
                camera, chest = (cameras[n, 0], cameras[n, 1], cameras[n, 2]), (chests[t, k, 0], chests[t, k, 1], chests[t, k, 2])
                if r < reach and sees(top, frame, camera, chest, 1.0):
                    add_view(detector, robot, (r, CAMERA_HEIGHT, STATURE), (dx / r, dy / r), 1.0, out[n, t, k])
    return out


@njit(cache=True)
def _nodes_at(node, goals, next_node, distance, driven):  # type: ignore[no-untyped-def]
    """The nodes (n, T) on the ways from a node to goals (n,) after distances driven (T,) m. distance: from the node to all nodes, m."""
    out = np.empty((len(goals), len(driven)), np.int64)
    for g in range(len(goals)):
        at = node
        for t in range(len(driven)):
            while at != goals[g] and distance[next_node[at, goals[g]]] <= driven[t]:
                at = next_node[at, goals[g]]
            out[g, t] = at
    return out
