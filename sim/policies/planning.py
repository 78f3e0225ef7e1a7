"""Policies that plan by expected information: greedy, which evaluates the next goal, and predictive, which evaluates whole paths.

Both maximize the environment's information (sim.placement.information) about predicted people. Each robot in turn chooses the goal with the most
expected information of the team. Predictive control follows Mayne et al. 2000, Constrained model predictive control: stability and optimality.
Only the first decision of the best path is executed, and the next decision plans anew.
Features of people for a learned policy give the information that a robot's choice adds about each person.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.placement.config import DECISION_RATE, FRAMES_PER_DECISION
from sim.placement.episode import detector_row
from sim.placement.information import (
    LOST_SIGMA,
    add_view,
    nats,
    predict_person,
    started_robots,
    update_person,
)
from sim.placement.map import CHEST_HEIGHT, PlacementMap
from sim.placement.visibility import sees
from sim.policies.policy import TeamKnowledge, waypoint_action
from sim.policies.waypoints import RECOVERY_TIME, UnseenMap, WaypointFeatures
from sim.robots.driving import TOP_YAW_RATE
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
DRIVING_SPEED = 0.6
"""Assumed speed along a planned path, m/s, once a robot has turned to it: less than the highest speed, as robots slow down in turns."""
ROUNDS = 2
"""Rounds in which the robots choose in turn, each given the choices of the others."""
REPEATED_VIEW_GAIN = (1.0, 0.4, 0.1)
"""Relative gain of a view of an unknown person whom no, one or two other robots also see."""
FOUND_SIGMA = 0.3
"""Standard deviation of the place of a person after the first box, m."""
INTERVAL = 1.5
"""Time between the places of a path at which predictive counts information, s."""
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
    table = information_from(knowledge, knowledge.place.roadmap.nodes[used][:, None], ahead)[:, 0]
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


def information_from(knowledge: TeamKnowledge, places: Array, forecast: PeopleAhead) -> Array:
    """Expected information (n, T, k, 2, 2), 1/m², of one frame about each person from places (n, T, 2) m at the times of the forecast."""
    place, config = knowledge.place, knowledge.config
    cameras, chests = (_above(place, points, height) for points, height in ((places, config.camera_height), (forecast.feet, CHEST_HEIGHT)))
    settings = detector_row(config), started_robots(1)[0], config.reach, config.camera_height
    return np.asarray(_information_from(place.scene.top, place.scene.frame, (cameras, chests), settings))


def _above(place: PlacementMap, points: Array, height: float) -> Array:
    """Points (..., 3) m at a height above the floor at points (..., 2) m."""
    z = place.floor_at(points.reshape(-1, 2)) + height
    return np.concatenate([points, z.reshape(*points.shape[:-1], 1)], axis=-1)


class Greedy:
    """Each robot goes to the nearby goal from which the team expects the most information about people, discounted by the path.

    Unknown people are expected where no robot looked recently (UnseenMap).
    """

    action = "waypoint"
    times, frames = np.array([INTERVAL]), FRAMES_PER_DECISION

    def begin(self, knowledge: TeamKnowledge, rng: np.random.Generator) -> None:
        self._goals = knowledge.place.roadmap.nearest(knowledge.robots[:, :2])
        self._unseen = UnseenMap(knowledge.place)

    def act(self, knowledge: TeamKnowledge) -> Array:
        place = knowledge.place
        here = self._unseen.update(knowledge, knowledge.config.period / RECOVERY_TIME)
        forecast = PeopleAhead.of(knowledge, self.times)
        goals = [self._candidates(place, int(node), int(goal)) for node, goal in zip(here, self._goals, strict=True)]
        ways = [self._ways(place, *of) for of in zip(knowledge.robots, here, goals, strict=True)]
        tables = [information_from(knowledge, way, forecast) for way in ways]
        visible = place.visible_from_nodes(knowledge.config.reach)
        ends = [visible[place.roadmap.nearest(way[:, -1])] for way in ways]
        unknown = max(knowledge.config.people - len(knowledge.position), 0) * 2.0 * math.log(LOST_SIGMA / FOUND_SIGMA) / len(self._unseen.density)
        chosen = [0] * len(here)
        for _ in range(ROUNDS):
            for k in range(len(here)):
                others = [q for q in range(len(here)) if q != k]
                value = team_values(forecast, self.frames, tables[k], [tables[q][chosen[q]] for q in others])
                value += unknown * self._unknown_found(ends[k], [ends[q][chosen[q]] for q in others])
                chosen[k] = self._best(place, value, goals[k], place.roadmap.distance[here[k]][goals[k]], [goals[q][chosen[q]] for q in others])
        self._goals = np.array([row[c] for row, c in zip(goals, chosen, strict=True)])
        return waypoint_action(place, self._goals)

    def _candidates(self, place: PlacementMap, node: int, goal: int) -> NDArray[np.int64]:
        """The goals (n,) that a robot at a node compares; the present one is first."""
        near = np.flatnonzero(place.roadmap.distance[node] <= MAX_PATH)
        return np.concatenate([[goal], near[near != goal]])

    def _ways(self, place: PlacementMap, robot: Array, node: int, goals: NDArray[np.int64]) -> Array:
        """Assumed places (n, T, 2) m of a robot at each time: here always the goal. robot (3,): x, y m and yaw rad."""
        return np.repeat(place.roadmap.nodes[goals][:, None], len(self.times), axis=1)

    def _unknown_found(self, visible: Mask, others: list[Mask]) -> Array:
        """Weighted expected number (n,) of unknown people seen at the end of each way.

        visible (n, points), others (points,): what the robot and each other one sees there.
        """
        views = sum((one.astype(np.int64) for one in others), np.zeros(visible.shape[1], dtype=np.int64))
        return np.asarray(visible @ (self._unseen.density * np.take(REPEATED_VIEW_GAIN, np.minimum(views, 2))))

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

    times = np.arange(1.0, 6.0) * INTERVAL
    frames = round(INTERVAL * DECISION_RATE) * FRAMES_PER_DECISION

    def _candidates(self, place: PlacementMap, node: int, goal: int) -> NDArray[np.int64]:
        found = super()._candidates(place, node, goal)
        return np.concatenate([found[:1], found[1:][:: max(1, math.ceil((len(found) - 1) / MOST_GOALS))]])

    def _ways(self, place: PlacementMap, robot: Array, node: int, goals: NDArray[np.int64]) -> Array:
        return np.asarray(_places_at(robot, node, goals, (place.roadmap.nodes, place.roadmap.next_node), (self.times, DRIVING_SPEED, TOP_YAW_RATE)))

    def _discounted(self, gain: Array, path: Array) -> Array:
        return gain


def team_values(forecast: PeopleAhead, frames: int, own: Array, others: Sequence[Array]) -> Array:
    """Expected information (n,), nats, summed over people and averaged over times, if one robot takes each of its n ways.

    frames: number of frames until each time. own (n, T, k, 2, 2), others (T, k, 2, 2): of `information_from`, by this robot and
    by each other one.
    """
    fixed = sum(others, np.zeros(own.shape[1:]))
    return np.asarray(_team_values(forecast.bounds, np.diff(forecast.times, prepend=0.0), frames, own, fixed))


@njit(cache=True)
def _team_values(bounds, steps, frames, own, fixed):  # type: ignore[no-untyped-def]
    out, P = np.zeros(len(own)), np.empty((4, 4))
    for w in range(len(own)):
        for k in range(len(bounds)):
            P[:] = bounds[k]
            for t in range(len(steps)):
                predict_person(P, steps[t])
                update_person(P, frames * (fixed[t, k] + own[w, t, k]))
                out[w] += nats(P) / len(steps)
    return out


@njit(cache=True)
def _information_from(top, frame, lines, settings):  # type: ignore[no-untyped-def]
    """`information_from` between cameras (n, T, 3) m and chests (T, k, 3) m over a map's columns.

    settings: detector, bound of a robot, reach m, height of a camera m.
    """
    (cameras, chests), (detector, robot, reach, height) = lines, settings
    out = np.zeros((len(cameras), chests.shape[0], chests.shape[1], 2, 2))
    for n in range(len(cameras)):
        for t in range(chests.shape[0]):
            camera = cameras[n, t, 0], cameras[n, t, 1], cameras[n, t, 2]
            for k in range(chests.shape[1]):
                dx, dy = chests[t, k, 0] - camera[0], chests[t, k, 1] - camera[1]
                r = math.sqrt(dx * dx + dy * dy) + 1e-9
                if r < reach and sees(top, frame, camera, (chests[t, k, 0], chests[t, k, 1], chests[t, k, 2]), 1.0):
                    add_view(detector, robot, (r, height, STATURE), (dx / r, dy / r), 1.0, out[n, t, k])
    return out


@njit(cache=True)
def _places_at(robot, node, goals, graph, pace):  # type: ignore[no-untyped-def]
    """Places (n, T, 2) m of a robot (3,) near a node, on its ways to goals (n,), which it turns to first.

    graph: nodes and next_node of the roadmap. pace: times (T,) s, speed m/s, yaw rate rad/s.
    """
    (nodes, next_node), (times, speed, rate) = graph, pace
    out = np.empty((len(goals), len(times), 2))
    for g in range(len(goals)):
        x, y, driven, target = robot[0], robot[1], 0.0, next_node[node, goals[g]]
        turn = (math.atan2(nodes[target, 1] - y, nodes[target, 0] - x) - robot[2] + math.pi) % (2 * math.pi) - math.pi
        for t in range(len(times)):
            far = max(times[t] - abs(turn) / rate, 0.0) * speed - driven
            while True:
                dx, dy = nodes[target, 0] - x, nodes[target, 1] - y
                step = math.sqrt(dx * dx + dy * dy)
                if step > far or target == goals[g]:
                    break
                x, y, driven, far = nodes[target, 0], nodes[target, 1], driven + step, far - step
                target = next_node[target, goals[g]]
            share = min(far / max(step, 1e-9), 1.0)
            out[g, t, 0], out[g, t, 1] = x + share * dx, y + share * dy
    return out
