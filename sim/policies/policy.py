"""The protocol of a policy that places robots, and baselines: random goals, a static ring, and Lloyd's coverage control."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from sim.placement.config import PlacementConfig
from sim.placement.episode import Episode
from sim.placement.map import PlacementMap
from sim.placement.observations import Observation
from tracker.geometry import Array

MAX_GOAL_TIME = 40
"""Decisions after which a random goal that was not reached is replaced."""

ORDER = 2
"""Number of nearest robots to which a point belongs in Lloyd's descent; 2 suits a reward for two views."""

RADII, ROTATIONS = np.linspace(0.2, 1.3, 12), 12
"""Candidate rings: radii over the root mean square distance of the walkable area from its centre, and the number of rotations."""


@dataclass(frozen=True, eq=False)
class TeamKnowledge:
    """The knowledge of a team before a decision.

    place: the map. config: the configuration, with the number of people. robots (r, 3): poses, x, y m and yaw rad.
    position (k, 2) m, velocity (k, 2) m/s, covariance (k, 2, 2) m²: of the people known. observation: as the environment gives it.
    """

    place: PlacementMap
    config: PlacementConfig
    robots: Array
    position: Array
    velocity: Array
    covariance: Array
    observation: Observation

    @staticmethod
    def of(episode: Episode, observation: Observation) -> TeamKnowledge:
        """The knowledge of the team of an episode, from its tracker where that is in the loop, else from its beliefs."""
        if episode.tracking is not None:
            memory = episode.tracking.memory
            robots, position, velocity, covariance = episode.tracking.planar_poses(), memory.position, memory.velocity, memory.covariance
        else:
            robots, velocity = episode.now.team[:, :3], episode.beliefs.mean[episode.beliefs.known > 0, 2:]
            position, covariance = episode.estimates()
        return TeamKnowledge(episode.place, episode.config, robots, position[:, :2], velocity, covariance[:, :2, :2], observation)


class Policy(Protocol):
    """Decides where robots go. action: the kind of its actions.

    `begin` gets the knowledge at the start of an episode. `act` gets that of each decision and returns an action (r, 2).
    """

    action: str

    def begin(self, knowledge: TeamKnowledge, rng: np.random.Generator) -> None: ...

    def act(self, knowledge: TeamKnowledge) -> Array: ...


def waypoint_action(place: PlacementMap, numbers: NDArray[np.int64]) -> Array:
    """The waypoint action (r, 2) that sends robots to these nodes of the roadmap (r,)."""
    return place.normalised(place.roadmap.nodes[numbers])


class Random:
    """Each robot goes to random nodes of the roadmap, one after another."""

    action = "waypoint"

    def begin(self, knowledge: TeamKnowledge, rng: np.random.Generator) -> None:
        self._rng = rng
        self._goals = rng.integers(len(knowledge.place.roadmap.nodes), size=len(knowledge.robots))
        self._since = np.zeros(len(knowledge.robots))

    def act(self, knowledge: TeamKnowledge) -> Array:
        places = knowledge.place.roadmap.nodes
        self._since += 1
        reached = np.hypot(*(places[self._goals] - knowledge.robots[:, :2]).T) < 0.5
        done = reached | (self._since > MAX_GOAL_TIME)
        self._goals = np.where(done, self._rng.integers(len(places), size=len(reached)), self._goals)
        self._since[done] = 0
        return waypoint_action(knowledge.place, self._goals)


class Static:
    """The robots drive to the best ring around the centre of the walkable area, and stay there."""

    action = "waypoint"

    def begin(self, knowledge: TeamKnowledge, rng: np.random.Generator) -> None:
        self._goals = best_ring(knowledge.place, len(knowledge.robots), knowledge.config.reach)

    def act(self, knowledge: TeamKnowledge) -> Array:
        # Goals are assigned again in each decision: two robots that meet swap goals.
        return waypoint_action(knowledge.place, assign_goals(knowledge, self._goals))


def best_ring(place: PlacementMap, robots: int, reach: float) -> NDArray[np.int64]:
    """The nodes (robots,) of the best candidate ring.

    Its value is the share of walkable points that two robots see, plus 0.3 times the share that one sees.
    """
    points = place.walkable_points[:, :2]
    centre = points.mean(axis=0)
    size = float(np.sqrt(((points - centre) ** 2).sum(axis=1).mean()))
    visible = place.visible_from_nodes(reach)
    best, chosen = -1.0, np.zeros(robots, dtype=np.int64)
    for radius in RADII * size:
        for phase in np.arange(ROTATIONS) * 2 * np.pi / ROTATIONS / robots:
            angle = phase + 2 * np.pi * np.arange(robots) / robots
            ring = place.roadmap.nearest(centre + radius * np.column_stack([np.cos(angle), np.sin(angle)]))
            views = visible[ring].sum(axis=0)
            value = float((views >= min(2, robots)).mean() + 0.3 * (views >= 1).mean())
            if value > best and len(np.unique(ring)) == robots:
                best, chosen = value, ring
    return chosen


def assign_goals(knowledge: TeamKnowledge, goals: NDArray[np.int64]) -> NDArray[np.int64]:
    """The goals, assigned to the robots with the least total path length."""
    roadmap = knowledge.place.roadmap
    distance = roadmap.distance[roadmap.nearest(knowledge.robots[:, :2])][:, goals]
    return goals[linear_sum_assignment(distance)[1]]


class Lloyd:
    """Coverage control by Lloyd's descent (Cortés, Martínez, Karataş and Bullo 2004, Coverage control for mobile sensing networks).

    The walkable area is divided into Voronoi cells of order ORDER: each point belongs to its nearest robots, by path length.
    Each robot goes to the node that sees most of its cell, weighted by PlacementMap.traffic. Visibility replaces the
    centroid, because walls occlude (Ganguli, Cortés and Bullo 2006, Distributed deployment of asynchronous guards in art galleries).
    Among equal nodes, the nearest to the whole cell is chosen.
    """

    action = "waypoint"

    def begin(self, knowledge: TeamKnowledge, rng: np.random.Generator) -> None:
        roadmap = knowledge.place.roadmap
        self._walkable = roadmap.nearest(knowledge.place.walkable_points[:, :2])
        self._visible = knowledge.place.visible_from_nodes(knowledge.config.reach)
        self._weight = knowledge.place.traffic
        self._goals = roadmap.nearest(knowledge.robots[:, :2])

    def act(self, knowledge: TeamKnowledge) -> Array:
        roadmap = knowledge.place.roadmap
        distance = roadmap.distance[self._goals][:, self._walkable]
        rank = np.argsort(np.argsort(distance, axis=0, kind="stable"), axis=0, kind="stable")
        for k in range(len(self._goals)):
            cell = rank[k] < ORDER
            if cell.any():
                mean_square = (roadmap.distance[:, self._walkable[cell]] ** 2).mean(axis=1)
                self._goals[k] = int(np.argmax(self._visible[:, cell] @ self._weight[cell] - 1e-4 * mean_square))
        return waypoint_action(knowledge.place, assign_goals(knowledge, self._goals))
