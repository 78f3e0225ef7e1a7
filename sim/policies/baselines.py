"""Where to send the robots: simple policies to compare others with. They know the map, their own places and what is believed of people."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from sim.placement.map import PlacementMap
from sim.policies.policy import Briefing, to_places
from tracker.geometry import Array

PATIENCE = 40
"""Decisions after which a random goal is given up."""

RADII, PHASES = np.linspace(0.2, 1.3, 12), 12
"""Of the rings that are tried: radii over the root mean square distance of where people walk from its middle, and how many turns."""


@dataclass
class Random:
    """Each robot to a place at random, then to another."""

    action: str = "waypoint"

    def begin(self, briefing: Briefing, rng: np.random.Generator) -> None:
        self._rng = rng
        self._goals = rng.integers(len(briefing.place.roads.places), size=len(briefing.robots))
        self._since = np.zeros(len(briefing.robots))

    def act(self, briefing: Briefing) -> Array:
        places = briefing.place.roads.places
        self._since += 1
        there = np.hypot(*(places[self._goals] - briefing.robots[:, :2]).T) < 0.5
        done = there | (self._since > PATIENCE)
        self._goals = np.where(done, self._rng.integers(len(places), size=len(there)), self._goals)
        self._since[done] = 0
        return to_places(briefing.place, self._goals)


@dataclass
class Static:
    """The ring around the middle of where people walk from which most of it is seen twice; the robots drive there and stay."""

    action: str = "waypoint"

    def begin(self, briefing: Briefing, rng: np.random.Generator) -> None:
        ring = best_ring(briefing.place, len(briefing.robots), briefing.config.reach)
        self._goals = ring

    def act(self, briefing: Briefing) -> Array:
        # Dealt anew each time: two who meet on their way change goals, not places.
        return to_places(briefing.place, assigned(briefing, self._goals))


def best_ring(place: PlacementMap, robots: int, reach: float) -> NDArray[np.int64]:
    """(robots,) places: of all rings tried, the one from which most of where people may be is seen by two, among equals by one."""
    ground = place.where_people_may_be[:, :2]
    middle = ground.mean(axis=0)
    size = float(np.sqrt(((ground - middle) ** 2).sum(axis=1).mean()))
    sees = place.sees(reach)
    best, chosen = -1.0, np.zeros(robots, dtype=np.int64)
    for radius in RADII * size:
        for phase in np.arange(PHASES) * 2 * np.pi / PHASES / robots:
            angle = phase + 2 * np.pi * np.arange(robots) / robots
            ring = place.roads.nearest(middle + radius * np.column_stack([np.cos(angle), np.sin(angle)]))
            views = sees[ring].sum(axis=0)
            value = float((views >= min(2, robots)).mean() + 0.3 * (views >= 1).mean())
            if value > best and len(np.unique(ring)) == robots:
                best, chosen = value, ring
    return chosen


def assigned(briefing: Briefing, goals: NDArray[np.int64]) -> NDArray[np.int64]:
    """The goals dealt to the robots so that all ways together are shortest."""
    roads = briefing.place.roads
    distance = roads.distance[roads.nearest(briefing.robots[:, :2])][:, goals]
    return goals[linear_sum_assignment(distance)[1]]


@dataclass
class Lloyd:
    """Coverage of where people walk, each part of it by the two nearest robots: each goes to the place that sees most of what is its own, by how
    much people are there (PlacementMap.traffic).

    Lloyd's descent as in Cortés, Martínez, Karataş and Bullo 2004, Coverage control for mobile sensing networks, with ways along the roads in place
    of straight ones, cells of order 2 as two views count, and in place of the centroid the best lookout, as walls hide what is near (Ganguli,
    Cortés and Bullo 2006, Distributed deployment of asynchronous guards in art galleries); among equals the nearest to all of the cell.
    """

    order: int = 2
    action: str = "waypoint"

    def begin(self, briefing: Briefing, rng: np.random.Generator) -> None:
        roads = briefing.place.roads
        self._ground = roads.nearest(briefing.place.where_people_may_be[:, :2])
        self._sees = briefing.place.sees(briefing.config.reach)
        self._weight = briefing.place.traffic
        self._goals = roads.nearest(briefing.robots[:, :2])

    def act(self, briefing: Briefing) -> Array:
        roads = briefing.place.roads
        distance = roads.distance[self._goals][:, self._ground]
        rank = np.argsort(np.argsort(distance, axis=0, kind="stable"), axis=0, kind="stable")
        for k in range(len(self._goals)):
            cell = rank[k] < self.order
            if cell.any():
                far = (roads.distance[:, self._ground[cell]] ** 2).mean(axis=1)
                self._goals[k] = int(np.argmax(self._sees[:, cell] @ self._weight[cell] - 1e-4 * far))
        return to_places(briefing.place, assigned(briefing, self._goals))
