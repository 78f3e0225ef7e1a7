"""Expected information from the nodes of a roadmap, and what a formation of robots is worth in the long run.

In the long run nothing is known of people but the traffic of the map. The best formation stands still, and plans of moving robots end in good ones.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from sim.placement.config import FRAMES_PER_DECISION, PlacementConfig
from sim.placement.episode import detector_row
from sim.placement.information import LOST_SIGMA, add_view, nats, started_robots
from sim.placement.map import CACHED_MAPS, CAMERA_HEIGHT, CHEST_HEIGHT, PlacementMap
from sim.placement.visibility import sees
from tracker.geometry import Array
from tracker.geometry.compilation import njit

STATURE = 1.72
"""Stature of people, of whom policies know none, m."""
DECISIONS = 2
"""Decisions whose views of a walking person count together."""
CLOSE = 1.2
"""Distance between the goals of two robots that is too close, m."""
MOST_ROUNDS = 8
"""Rounds in which the robots of the best formation are moved in turn."""


def information_from(place: PlacementMap, config: PlacementConfig, nodes: NDArray[np.int64], feet: Array) -> Array:
    """Expected information (n, T, k, 2, 2), 1/m², of one frame from each node of the roadmap about people whose feet (T, k, 2) m are there."""
    flat = feet.reshape(-1, 2)
    chests = np.column_stack([flat, place.floor_at(flat) + CHEST_HEIGHT]).reshape(*feet.shape[:2], 3)
    settings = detector_row(config), started_robots(1)[0], config.reach
    return np.asarray(_information_from((place.scene.top, place.scene.frame), place.node_cameras[nodes], chests, settings))


@dataclass(frozen=True, eq=False)
class Coverage:
    """information (n, k, 2, 2), 1/m²: of DECISIONS decisions from each of nodes (n, 2) m about a person at each of `walkable_points`.

    weight (k,): share of the people who are expected there.
    """

    nodes: Array
    information: Array
    weight: Array

    def values(self, nodes: NDArray[np.int64], others: NDArray[np.int64]) -> Array:
        """Expected information (n,) about a person, nats, of robots at the nodes `others` (m,) and one at each of nodes (n,) in turn."""
        fixed = self.information[others].sum(axis=0)
        return np.asarray(_coverage(self.information, self.weight, nodes, fixed))

    def best_formation(self, robots: int) -> NDArray[np.int64]:
        """Nodes (robots,): each robot takes the best node beside those before it, and then moves in turn until none gains."""
        chosen = np.zeros(0, dtype=np.int64)
        for _ in range(robots):
            chosen = np.append(chosen, self._best(chosen))
        for _ in range(MOST_ROUNDS):
            before = chosen.copy()
            for k in range(robots):
                chosen[k] = self._best(np.delete(chosen, k))
            if (chosen == before).all():
                break
        return chosen

    def _best(self, others: NDArray[np.int64]) -> int:
        gap = np.linalg.norm(self.nodes[:, None] - self.nodes[others], axis=2).min(axis=1, initial=np.inf)
        return int(np.argmax(self.values(np.arange(len(self.nodes)), others) - 1e3 * (gap < CLOSE)))


@lru_cache(maxsize=CACHED_MAPS)
def coverage_of(place: PlacementMap, config: PlacementConfig) -> Coverage:
    """The coverage of a map with the detector and the reach of a configuration, cached."""
    nodes = place.roadmap.nodes
    found = information_from(place, config, np.arange(len(nodes)), place.walkable_points[None, :, :2])[:, 0]
    return Coverage(nodes, DECISIONS * FRAMES_PER_DECISION * found, place.traffic / place.traffic.sum())


@njit(cache=True)
def _coverage(information, weight, nodes, fixed):  # type: ignore[no-untyped-def]
    """`Coverage.values`. fixed (k, 2, 2), 1/m²: of the others."""
    out, P, unknown = np.zeros(len(nodes)), np.empty((2, 2)), 2.0 / (LOST_SIGMA * LOST_SIGMA)
    for n in range(len(nodes)):
        for k in range(len(weight)):
            J, other = information[nodes[n], k], fixed[k]
            a, b, c = unknown + other[0, 0] + J[0, 0], other[0, 1] + J[0, 1], unknown + other[1, 1] + J[1, 1]
            if a + c > 2.0 * unknown:
                det = a * c - b * b
                P[0, 0], P[0, 1], P[1, 1] = c / det, -b / det, a / det
                out[n] += weight[k] * nats(P)
    return out


@njit(cache=True)
def _information_from(elevation, cameras, chests, settings):  # type: ignore[no-untyped-def]
    """`information_from` for cameras (n, 3) m and chests (T, k, 3) m. settings: detector, bound of a robot, reach m."""
    detector, robot, reach = settings
    out = np.zeros((len(cameras), chests.shape[0], chests.shape[1], 2, 2))
    for n in range(len(cameras)):
        for t in range(chests.shape[0]):
            for k in range(chests.shape[1]):
                dx, dy = chests[t, k, 0] - cameras[n, 0], chests[t, k, 1] - cameras[n, 1]
                r = math.sqrt(dx * dx + dy * dy) + 1e-9
                if r < reach and sees(elevation, (cameras[n, 0], cameras[n, 1], cameras[n, 2]), (chests[t, k, 0], chests[t, k, 1], chests[t, k, 2])):
                    add_view(detector, robot, (r, CAMERA_HEIGHT, STATURE), (dx / r, dy / r), 1.0, out[n, t, k])
    return out
