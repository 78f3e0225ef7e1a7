"""Robots that go where they will learn most: greedy information gain, one move ahead."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from sim.placement.beliefs import AZIMUTH, ELEVATION, LOST, PLACE
from sim.placement.map import PlacementMap
from sim.placement.visibility import clear
from sim.policies.policy import Briefing, to_places
from sim.policies.waypoints import FADING, UnseenMap
from tracker.geometry import Array

AHEAD = 1.5
"""s: people are met where they will be by then, if they go on."""
REACH, HASTE = 6.0, 7.0
"""m along the roads to the farthest place that a robot considers, and m after which what is gained there counts 1/e."""
STAYING = 0.05
"""nats by which another place must be better than the present goal."""
SWEEPS = 2
"""Times that the robots reconsider in turn, each knowing what the others choose."""
SECOND_LOOK = (1.0, 0.4, 0.1)
"""What a look at somebody who is not known yet tells when nobody, one or two others look there, too."""
CHEST = 1.2
CORNERS = np.array([(0.0, 0.0), (1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0)])
"""Places of somebody that are looked at, standard deviations off along the axes."""


class Greedy:
    """Robot by robot, the place near by from which the team learns most: the gain of log det of the people whom it knows, and finding those whom it
    does not, who may be wherever nobody looked for a while.
    """

    action = "waypoint"

    def begin(self, briefing: Briefing, rng: np.random.Generator) -> None:
        place = briefing.place
        self._goals = place.roads.nearest(briefing.robots[:, :2])
        self._hope = UnseenMap(place)

    def act(self, briefing: Briefing) -> Array:
        place = briefing.place
        sees = place.sees(briefing.config.reach)
        here = self._hope.look(briefing, briefing.config.period / FADING)
        unknown = max(briefing.config.people - len(briefing.position), 0)
        # Whoever is not known counts from LOST to a view's own error.
        worth = unknown * 2.0 * math.log(LOST / 0.3) / len(self._hope.left)
        points, spread = _met(briefing)
        away = place.roads.distance[here]
        candidates = [np.flatnonzero(row <= REACH) for row in away]
        gains = [_precision(place, numbers, points, briefing.config.reach) for numbers in candidates]
        chosen = [int(np.argmin(np.abs(numbers - h))) for numbers, h in zip(candidates, here, strict=True)]
        for k, goal in enumerate(self._goals):
            if goal in candidates[k]:
                chosen[k] = int(np.searchsorted(candidates[k], goal))
        for _ in range(SWEEPS):
            for k in range(len(here)):
                others = sum((gains[q][chosen[q]] for q in range(len(here)) if q != k), np.zeros_like(gains[k][0]))
                taken = [candidates[q][chosen[q]] for q in range(len(here)) if q != k]
                views = sees[taken].sum(axis=0)
                left = np.choose(np.minimum(views, 2), SECOND_LOOK)
                value = _information(spread, others, gains[k]) + worth * (sees[candidates[k]] @ (self._hope.left * left))
                gap = place.roads.places[candidates[k]][:, None] - place.roads.places[taken]
                crowded = np.linalg.norm(gap, axis=2).min(axis=1, initial=9.0) < 1.2
                value = (value - value[chosen[k]]) * np.exp(-away[k][candidates[k]] / HASTE) - 1e3 * crowded
                value[chosen[k]] = STAYING
                chosen[k] = int(np.argmax(value))
        self._goals = np.array([numbers[c] for numbers, c in zip(candidates, chosen, strict=True)])
        return to_places(place, self._goals)


def _met(briefing: Briefing) -> tuple[Array, Array]:
    """(k, 5, 2) m where people may be AHEAD s from now, and (k, 2, 2) m² how sure that is, not surer than a step aside."""
    position = briefing.position + AHEAD * 0.5 * briefing.velocity
    spread = briefing.covariance + np.eye(2) * (0.3**2 + 0.6 * AHEAD**3 / 3)
    root = np.linalg.cholesky(spread) if len(spread) else np.zeros((0, 2, 2))
    return position[:, None] + np.einsum("kij,cj->kci", root, CORNERS), spread


def _precision(place: PlacementMap, numbers: NDArray[np.int64], points: Array, reach: float) -> Array:
    """(n, k, 2, 2) 1/m²: what a look from each of these places of the roads would tell of each of the people at points (k, 5, 2) m."""
    flat = points.reshape(-1, 2)
    goals = np.column_stack([flat, place.floor_at(flat) + CHEST])
    share = np.zeros((len(numbers), len(points)))
    if len(points):
        for n, number in enumerate(numbers):
            share[n] = clear(place.heights, place.lookouts[number], goals).reshape(len(points), -1).mean(axis=1)
    return _told(place.roads.places[numbers], points[:, 0], share, reach)


@njit(cache=True)
def _told(places, people, share, reach):  # type: ignore[no-untyped-def]
    out = np.zeros((len(places), len(people), 2, 2))
    for n in range(len(places)):
        for k in range(len(people)):
            dx, dy = places[n, 0] - people[k, 0], places[n, 1] - people[k, 1]
            r = math.sqrt(dx * dx + dy * dy) + 1e-9
            if r > reach or share[n, k] <= 0:
                continue
            far = share[n, k] / ((ELEVATION * (r * r + 2.25) / 1.5) ** 2 + PLACE**2)
            wide = share[n, k] / ((AZIMUTH * r) ** 2 + PLACE**2)
            c, s = dx / r, dy / r
            out[n, k, 0, 0], out[n, k, 1, 1] = far * c * c + wide * s * s, far * s * s + wide * c * c
            out[n, k, 0, 1] = out[n, k, 1, 0] = (far - wide) * c * s
    return out


@njit(cache=True)
def _information(spread, others, gains):  # type: ignore[no-untyped-def]
    """(n,) nats: ½ log det(1 + P Λ) summed over people of covariance P, Λ what the others (k, 2, 2) and one more place (n, k, 2, 2) tell."""
    out = np.zeros(len(gains))
    for n in range(len(gains)):
        for k in range(len(spread)):
            L, P = others[k] + gains[n, k], spread[k]
            a, b = 1.0 + P[0, 0] * L[0, 0] + P[0, 1] * L[1, 0], P[0, 0] * L[0, 1] + P[0, 1] * L[1, 1]
            c, d = P[1, 0] * L[0, 0] + P[1, 1] * L[1, 0], 1.0 + P[1, 0] * L[0, 1] + P[1, 1] * L[1, 1]
            out[n] += 0.5 * math.log(max(a * d - b * c, 1e-12))
    return out
