"""Policies that plan by expected information: greedy, which evaluates the next goal, and predictive, which evaluates whole paths.

Both maximize the environment's information (sim.placement.information) about predicted people. Each robot in turn chooses the goal with the most
expected information of the team. Predictive control follows Mayne et al. 2000, Constrained model predictive control: stability and optimality.
Only the first decision of the best path is executed, and the next decision plans anew. Its people take several ways, which are drawn by their
direction of motion among the shortest paths of the map. Greedy and the features of the learned policy predict straight ways.
Features for a learned policy tell the value of each choice as predictive control counts it, and the information that it adds about each person.
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
from sim.placement.roadmap import nearest_node
from sim.placement.visibility import sees
from sim.policies.policy import TeamKnowledge, waypoint_action
from sim.policies.waypoints import CHOICES, HOLD, POINT_FEATURES, RECOVERY_TIME, UnseenMap, WaypointFeatures, choices_of
from sim.robots.driving import TOP_YAW_RATE
from tracker.geometry import Array, Mask
from tracker.geometry.compilation import njit

PEOPLE_FEATURES, FEATURES = 5, POINT_FEATURES + 1
"""Number of features of a person at a choice, and of a choice, the last of which is its value."""
NATS_SCALE, DISTANCE_SCALE = 6.0, 12.0
"""Nats and metres that are scaled to 1."""


Features = NDArray[np.float32]
STATURE = 1.72
"""Assumed stature of people, which policies do not know, m."""
KEEPS_WALKING = 4.0
"""Time constant with which the predicted velocity of a person decays on a straight way, s."""
WAYS, WAY_DURATION = 4, 12.0
"""Number of ways of a person that predictive samples, and time constant of the decay of speed along them, s."""
WAY_BEGINNING, LEAST_WAY, WAY_CONCENTRATION = 3.0, 0.7, 6.0
"""Length of the part of a way that gives its direction, m; least length of a way, m; concentration of directions at 1 m/s."""
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
LARGEST_LOSS = 30.0
"""Bound of the loss of a choice against the best one in the features of a learned policy, nats."""
CLOSE = 1.2
"""Distance between the goals of two robots that is too close, m."""


@dataclass(frozen=True, eq=False)
class PeopleAhead:
    """k people, or ways of people, at T times ahead: times (T,) s, feet (T, k, 2) m, and current bounds (k, 4, 4). probability: of each way."""

    times: Array
    feet: Array
    bounds: Array
    probability: float = 1.0

    @staticmethod
    def of(knowledge: TeamKnowledge, times: Array) -> PeopleAhead:
        """Predict people with velocities that decay with the time constant KEEPS_WALKING."""
        ahead = KEEPS_WALKING * (1.0 - np.exp(-times / KEEPS_WALKING))
        bounds = np.zeros((len(knowledge.position), 4, 4))
        bounds[:, :2, :2] = knowledge.covariance
        bounds[:, 2, 2] = bounds[:, 3, 3] = TRACKED_VELOCITY_SIGMA**2
        return PeopleAhead(times, knowledge.position + ahead[:, None, None] * knowledge.velocity, bounds)

    @staticmethod
    def sampled(knowledge: TeamKnowledge, times: Array) -> PeopleAhead:
        """WAYS equally probable ways of each person along the roadmap. All nodes are goals.

        Their weights are a von Mises density of the angle between the velocity and the beginning of the way. It is wide for slow people.
        """
        straight, roadmap = PeopleAhead.of(knowledge, times), knowledge.place.roadmap
        people = np.ascontiguousarray(knowledge.position), np.ascontiguousarray(knowledge.velocity)
        travelled = WAY_DURATION * (1.0 - np.exp(-times / WAY_DURATION))
        feet = _sampled_ways(people, (roadmap.nodes, roadmap.next_node), travelled, (WAYS, WAY_BEGINNING, LEAST_WAY, WAY_CONCENTRATION))
        return PeopleAhead(times, feet, np.repeat(straight.bounds, WAYS, axis=0), 1.0 / WAYS)


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


@dataclass(frozen=True, eq=False)
class TeamPlan:
    """A plan of r robots. Of each robot: goals (n,), nodes of the roadmap; tables (n, T, k, 2, 2) of `information_from` on its ways to them.

    chosen: the index of the goal of each robot. values (n,): of its goals when it chose last, nats.
    """

    forecast: PeopleAhead
    goals: list[NDArray[np.int64]]
    tables: list[Array]
    chosen: list[int]
    values: list[Array]

    def others(self, robot: int) -> list[Array]:
        """The information (T, k, 2, 2) from the way of each other robot."""
        return [table[c] for q, (table, c) in enumerate(zip(self.tables, self.chosen, strict=True)) if q != robot]


class Greedy:
    """Each robot goes to the nearby goal from which the team expects the most information about people, discounted by the path.

    Unknown people are expected where no robot looked recently (UnseenMap).
    """

    action = "waypoint"
    times, frames, hold = np.array([INTERVAL]), FRAMES_PER_DECISION, 1

    def begin(self, knowledge: TeamKnowledge, rng: np.random.Generator) -> None:
        self._goals = knowledge.place.roadmap.nearest(knowledge.robots[:, :2])
        self._unseen = UnseenMap(knowledge.place)

    def act(self, knowledge: TeamKnowledge) -> Array:
        plan = self.plan(knowledge)
        self._goals = np.array([row[c] for row, c in zip(plan.goals, plan.chosen, strict=True)])
        return waypoint_action(knowledge.place, self._goals)

    def plan(self, knowledge: TeamKnowledge) -> TeamPlan:
        """The plan of the team. Each robot in turn takes its best goal, ROUNDS times."""
        place = knowledge.place
        here = self._unseen.update(knowledge, self.hold * knowledge.config.period / RECOVERY_TIME)
        forecast = self._forecast(knowledge)
        goals = [self._candidates(place, int(node), int(goal)) for node, goal in zip(here, self._goals, strict=True)]
        ways = [self._ways(place, *of) for of in zip(knowledge.robots, here, goals, strict=True)]
        visible = place.visible_from_nodes(knowledge.config.reach)
        ends = [visible[place.roadmap.nearest(way[:, -1])] for way in ways]
        plan = TeamPlan(forecast, goals, [information_from(knowledge, way, forecast) for way in ways], [0] * len(here), [np.zeros(0)] * len(here))
        unknown = max(knowledge.config.people - len(knowledge.position), 0) * 2.0 * math.log(LOST_SIGMA / FOUND_SIGMA) / len(self._unseen.density)
        before: list[list[int] | None] = [None] * len(here)
        for _ in range(ROUNDS):
            for k in range(len(here)):
                others = [q for q in range(len(here)) if q != k]
                now = [plan.chosen[q] for q in others]
                if now == before[k]:
                    continue
                before[k] = now
                value = team_values(forecast, self.frames, plan.tables[k], plan.others(k))
                value += unknown * self._unknown_found(ends[k], [ends[q][c] for q, c in zip(others, now, strict=True)])
                gap = [goals[q][c] for q, c in zip(others, now, strict=True)]
                plan.values[k] = self._values(place, value, goals[k], place.roadmap.distance[here[k]][goals[k]], gap)
                plan.chosen[k] = int(np.argmax(plan.values[k]))
        return plan

    def _forecast(self, knowledge: TeamKnowledge) -> PeopleAhead:
        return PeopleAhead.of(knowledge, self.times)

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

    def _values(self, place: PlacementMap, value: Array, goals: NDArray[np.int64], path: Array, others: list[int]) -> Array:
        """Values (n,) of the goals, nats, relative to the present goal, which has SWITCHING_GAIN: others must be better by it."""
        gap = np.linalg.norm(place.roadmap.nodes[goals][:, None] - place.roadmap.nodes[np.array(others, dtype=np.int64)], axis=2)
        gain = self._discounted(value - value[0], path) - 1e3 * (gap.min(axis=1, initial=9.0) < CLOSE)
        gain[0] += SWITCHING_GAIN
        return np.asarray(gain)

    def _discounted(self, gain: Array, path: Array) -> Array:
        return np.asarray(gain * np.exp(-path / PATH_DISCOUNT))


class Predictive(Greedy):
    """Model predictive control: each robot compares paths over the next 7.5 s, while people take sampled ways."""

    times = np.arange(1.0, 6.0) * INTERVAL
    frames = round(INTERVAL * DECISION_RATE) * FRAMES_PER_DECISION

    def _candidates(self, place: PlacementMap, node: int, goal: int) -> NDArray[np.int64]:
        found = super()._candidates(place, node, goal)
        return np.concatenate([found[:1], found[1:][:: max(1, math.ceil((len(found) - 1) / MOST_GOALS))]])

    def _forecast(self, knowledge: TeamKnowledge) -> PeopleAhead:
        return PeopleAhead.sampled(knowledge, self.times)

    def _ways(self, place: PlacementMap, robot: Array, node: int, goals: NDArray[np.int64]) -> Array:
        return np.asarray(_places_at(robot, node, goals, (place.roadmap.nodes, place.roadmap.next_node), (self.times, DRIVING_SPEED, TOP_YAW_RATE)))

    def _discounted(self, gain: Array, path: Array) -> Array:
        return gain


class ChoicePlan(Predictive):
    """Predictive control among the choices of the learned policy. Goals are the present one, then the choices."""

    times, hold = np.array([2.5, 5.0, 7.5]), HOLD
    frames = round(2.5 * DECISION_RATE) * FRAMES_PER_DECISION

    def _forecast(self, knowledge: TeamKnowledge) -> PeopleAhead:
        # Sampled ways would cost twice as much in training, and an untrained network gains nothing by them.
        return PeopleAhead.of(knowledge, self.times)

    def _candidates(self, place: PlacementMap, node: int, goal: int) -> NDArray[np.int64]:
        return np.concatenate([[goal], choices_of(place)[0][node]])

    def chosen(self, goals: NDArray[np.int64]) -> None:
        """Set the goals (r,) that the robots are bound for."""
        self._goals = goals


class ChoiceFeatures:
    """The features of the choices of a team during an episode."""

    def __init__(self, knowledge: TeamKnowledge) -> None:
        self._waypoints, self._planner = WaypointFeatures(knowledge), ChoicePlan()
        self._planner.begin(knowledge, np.random.default_rng(0))

    def update(self, knowledge: TeamKnowledge) -> tuple[Features, Features]:
        """Features (r, CHOICES, FEATURES) of the new choices, and (r, k, CHOICES, PEOPLE_FEATURES) of k known people at them.

        Choices have the features of WaypointFeatures, and the value of ChoicePlan less that of the best choice, over 6 nats.
        People have, while the other robots are on the ways that ChoicePlan chooses for them:

        * 0: 1, while padding rows are 0. 1 to 3, over 6 nats: mean information along the way to the choice; the robot's share of it; information now.
        * 4: distance of the person from the choice over 12 m.

        If there are more tracks than people, only the best known tracks are kept.
        """
        points, plan, place = self._waypoints.update(knowledge), self._planner.plan(knowledge), knowledge.place
        people = np.zeros((len(points), len(knowledge.position), CHOICES, PEOPLE_FEATURES), dtype=np.float32)
        value = np.stack(plan.values)[:, 1:]
        value = np.maximum(value - value.max(axis=1, keepdims=True), -LARGEST_LOSS) / NATS_SCALE
        pace = np.diff(plan.forecast.times, prepend=0.0), self._planner.frames
        for k, table in enumerate(plan.tables):
            fixed = sum(plan.others(k), np.zeros(table.shape[1:]))
            where = plan.forecast.bounds, knowledge.position, place.roadmap.nodes[self._waypoints.goals[k]]
            _fill(people[k], where, table[1:], fixed, pace)
        choices = np.concatenate([points, value[..., None]], axis=2, dtype=np.float32)
        if people.shape[1] > knowledge.config.people:
            best = np.argsort(-people[0, :, 0, 3], kind="stable")[: knowledge.config.people]
            people = people[:, best]
        return choices, people

    def chosen(self, choice: NDArray[np.int64]) -> NDArray[np.int64]:
        """The nodes (r,) of the choices (r,), which the robots are bound for from now on."""
        goals = self._waypoints.goals[np.arange(len(choice)), choice]
        self._planner.chosen(goals)
        return goals


@njit(cache=True)
def _fill(out, where, table, fixed, pace):  # type: ignore[no-untyped-def]
    """Fill the features (k, c, 5) of people at the choices of a robot, in `ChoiceFeatures.update`.

    where: bounds (k, 4, 4), places (k, 2) m of people, and nodes (c, 2) m of the choices. table (c, T, k, 2, 2), fixed (T, k, 2, 2): information of
    a frame from the way to each choice, and from all others. pace: s before each time (T,), and number of frames.
    """
    (bounds, feet, nodes), times = where, len(pace[0])
    alone, each = np.empty(times), np.empty((len(nodes), times))
    for k in range(len(bounds)):
        _nats_of_person(bounds[k], pace, fixed[:, k], table[:, :, k], alone, each)
        without, now = _mean(alone), nats(bounds[k])
        for c in range(len(nodes)):
            found = _mean(each[c])
            out[k, c, 0], out[k, c, 1] = 1.0, found / NATS_SCALE
            out[k, c, 2], out[k, c, 3] = (found - without) / NATS_SCALE, now / NATS_SCALE
            out[k, c, 4] = np.sqrt((nodes[c, 0] - feet[k, 0]) ** 2 + (nodes[c, 1] - feet[k, 1]) ** 2) / DISTANCE_SCALE


@njit(cache=True)
def _mean(values):  # type: ignore[no-untyped-def]
    """The mean of values (T,)."""
    out = 0.0
    for t in range(len(values)):
        out += values[t] / len(values)
    return out


def team_values(forecast: PeopleAhead, frames: int, own: Array, others: Sequence[Array]) -> Array:
    """Expected information (n,), nats, summed over people and averaged over times, if one robot takes each of its n ways.

    frames: number of frames until each time. own (n, T, k, 2, 2), others (T, k, 2, 2): of `information_from`, by this robot and
    by each other one.
    """
    fixed, pace = sum(others, np.zeros(own.shape[1:])), (np.diff(forecast.times, prepend=0.0), frames)
    return np.asarray(forecast.probability * _team_values(forecast.bounds, pace, own, fixed))


@njit(cache=True)
def _team_values(bounds, pace, own, fixed):  # type: ignore[no-untyped-def]
    out, alone, each = np.zeros(len(own)), np.empty(len(pace[0])), np.empty(own.shape[:2])
    for k in range(len(bounds)):
        _nats_of_person(bounds[k], pace, fixed[:, k], own[:, :, k], alone, each)
        for w in range(len(own)):
            for t in range(own.shape[1]):
                out[w] += each[w, t] / own.shape[1]
    return out


@njit(cache=True)
def _nats_of_person(bound, pace, fixed, own, alone, each):  # type: ignore[no-untyped-def]
    """Information about a person with a bound (4, 4), nats: each (n, T) with one robot on each of its n ways, alone (T,) without it.

    pace: s before each time (T,), and number of frames. fixed (T, 2, 2), own (n, T, 2, 2): information of a frame from the others and from the ways.
    """
    (steps, frames), P, J = pace, np.empty((4, 4)), np.empty((2, 2))
    for w in range(-1, len(own)):
        out, seen = alone if w < 0 else each[w], False
        for t in range(len(steps)):
            seen |= w >= 0 and (own[w, t, 0, 0] > 0 or own[w, t, 1, 1] > 0)
        if w >= 0 and not seen:
            # Nobody is seen from most ways, which saves most of the time.
            out[:] = alone
            continue
        P[:] = bound
        for t in range(len(steps)):
            predict_person(P, steps[t])
            for i in range(2):
                for j in range(2):
                    J[i, j] = frames * (fixed[t, i, j] + own[w, t, i, j] if seen else fixed[t, i, j])
            update_person(P, J)
            out[t] = nats(P)


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
    """Places (n, T, 2) m of a robot (3,) near a node, on its ways to goals (n,). It turns to a way first.

    graph: nodes and next_node of the roadmap. pace: times (T,) s, speed m/s, yaw rate rad/s.
    """
    (nodes, next_node), (times, speed, rate) = graph, pace
    out, travelled = np.empty((len(goals), len(times), 2)), np.empty(len(times))
    for g in range(len(goals)):
        target = next_node[node, goals[g]]
        turn = (math.atan2(nodes[target, 1] - robot[1], nodes[target, 0] - robot[0]) - robot[2] + math.pi) % (2 * math.pi) - math.pi
        for t in range(len(times)):
            travelled[t] = max(times[t] - abs(turn) / rate, 0.0) * speed
        _walk((robot[0], robot[1]), (node, goals[g]), graph, travelled, out[g])
    return out


@njit(cache=True)
def _sampled_ways(people, graph, travelled, settings):  # type: ignore[no-untyped-def]
    """Feet (T, k · ways, 2) m of people on sampled ways, in `PeopleAhead.sampled`.

    people: position (k, 2) m, velocity (k, 2) m/s. graph: nodes and next_node of the roadmap. travelled (T,) s: distance over speed.
    settings: number of ways, length of their beginning m, least length m, concentration at 1 m/s.
    """
    (position, velocity), (nodes, next_node), (ways, beginning, least, concentration) = people, graph, settings
    out, weight = np.zeros((len(travelled), len(position) * ways, 2)), np.zeros(len(nodes))
    for k in range(len(position)):
        x, y = position[k, 0], position[k, 1]
        speed, start = math.sqrt(velocity[k, 0] ** 2 + velocity[k, 1] ** 2), nearest_node(nodes, x, y)[0]
        for goal in range(len(nodes)):
            node, dx, dy, length = start, nodes[start, 0] - x, nodes[start, 1] - y, 0.0
            while node != goal and length < beginning:
                node = next_node[node, goal]
                dx, dy = nodes[node, 0] - x, nodes[node, 1] - y
                length = math.sqrt(dx * dx + dy * dy)
            length = math.sqrt(dx * dx + dy * dy) + 1e-9
            cosine = (dx * velocity[k, 0] + dy * velocity[k, 1]) / (length * (speed + 1e-9))
            weight[goal] = math.exp(concentration * min(speed, 1.0) * (cosine - 1.0)) if length > least else 0.0
        # Systematic sampling over nodes, which are numbered by columns, spreads the ways.
        total, passed, way = weight.sum(), 0.0, 0
        for goal in range(len(nodes)):
            passed += weight[goal] / total if total > 0 else 1.0 / len(nodes)
            while way < ways and passed > (way + 0.5) / ways - 1e-12:
                _walk((x, y), (start, goal), graph, speed * travelled, out[:, k * ways + way])
                way += 1
    return out


@njit(cache=True)
def _walk(where, ends, graph, travelled, out):  # type: ignore[no-untyped-def]
    """Places out (T, 2) m on the way from a point (x, y) m near a node to a goal, after distances travelled (T,) m. ends: node and goal."""
    (x, y), (node, goal), (nodes, next_node), driven = where, ends, graph, 0.0
    target = next_node[node, goal]
    for t in range(len(travelled)):
        far = travelled[t] - driven
        while True:
            dx, dy = nodes[target, 0] - x, nodes[target, 1] - y
            step = math.sqrt(dx * dx + dy * dy)
            if step > far or target == goal:
                break
            x, y, driven, far = nodes[target, 0], nodes[target, 1], driven + step, far - step
            target = next_node[target, goal]
        share = min(far / max(step, 1e-9), 1.0)
        out[t, 0], out[t, 1] = x + share * dx, y + share * dy
