"""Observations of a policy: named arrays in [−1, 1] of fixed shapes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from gymnasium import spaces

from sim.placement.config import SPEED, YAW, YAW_RATE, PlacementConfig, X, Y
from sim.placement.episode import Episode
from sim.robots.driving import TOP_SPEED, TOP_YAW_RATE
from tracker.geometry.compilation import njit

SIGMA_SCALE = 4.0
"""Standard deviation that is scaled to 1 in beliefs, m."""
SPEED_SCALE = 2.0
"""Speed that is scaled to 1 in beliefs, m/s."""
HEIGHT_SCALE = 2.0
"""Height difference that is scaled to 1 in local maps, m."""
ROBOT_FEATURES, SEEN_FEATURES, BELIEF_FEATURES = 6, 5, 9
"""Number of features of a robot, of a person seen, and of a belief."""

Observation = dict[str, np.ndarray]


def space_of(config: PlacementConfig) -> spaces.Dict:
    """The space of `observe`.

    * robots (r, 6): x, y over the extent, cos and sin of the heading, speed and yaw rate over their maxima.
    * seen (r, p, 5): 1 for a person seen (else the row is 0), cos and sin of the azimuth relative to the heading, distance over the reach.
      The last number is the share of the body seen. Rows are ordered by person. With observation "tracks" they are detections, ordered by azimuth.
    * map (r, 2, n, n): heights of the terrain relative to the robot's ground, and of objects above the terrain.
      Rows run north, columns east.
    * beliefs (k, 9): 1 for a known person (else the row is 0), x, y over the extent, velocity, standard deviations along x and y, their
      correlation, and the time since the person was seen over 30 s. With "tracks", they are the people of TrackMemory.
    * panoramas (r · height, width, 3) uint8: one robot below the other, only with observation "pixels".
    """
    r = config.robots
    boxes: dict[str, spaces.Space] = {name: spaces.Box(-1.0, 1.0, shape, np.float32) for name, shape in shapes_of(config).items() if np.prod(shape)}
    if config.observation == "pixels":
        boxes["panoramas"] = spaces.Box(0, 255, (r * config.width // 2, config.width, 3), np.uint8)
    return spaces.Dict(boxes)


def shapes_of(config: PlacementConfig) -> dict[str, tuple[int, ...]]:
    """The shapes of all arrays but panoramas, in the order of `_observe`."""
    r, n = config.robots, config.cells
    slots = config.people if config.observation != "tracks" else config.max_tracks
    return {"robots": (r, ROBOT_FEATURES), "seen": (r, slots, SEEN_FEATURES), "map": (r, 2, n, n), "beliefs": (config.max_tracks, BELIEF_FEATURES)}


def empty(config: PlacementConfig, count: int) -> Observation:
    """Zero arrays for the observations of `count` episodes: as in `space_of`, with a leading axis (count,), without panoramas."""
    return {name: np.zeros((count, *shape), np.float32) for name, shape in shapes_of(config).items()}


def observe(episodes: Sequence[Episode], out: Observation) -> None:
    """Fill the rows of arrays from `empty` for episodes of one map that share their States."""
    first = episodes[0]
    config, place = first.config, first.place
    size = config.cells, config.cell, config.reach
    if first.tracking is None:
        rows = np.array([episode.row for episode in episodes], dtype=np.int64)
        _observe(rows, first.states, (place.scene, place.extent), size, tuple(out.values()))
        return
    for episode in episodes:
        assert episode.tracking is not None
        team, row = np.column_stack([episode.tracking.planar_poses(), episode.now.team[:, 3:]]), episode.row
        robot_rows(team, place.extent, out["robots"][row])
        out["seen"][row] = episode.tracking.detection_rows()
        memory, most = episode.tracking.memory, config.max_tracks
        mean = np.column_stack([memory.position, memory.velocity])[:most]
        _belief_rows((np.ones(len(mean)), mean, memory.covariance[:most]), memory.time_unseen[:most], place.extent, out["beliefs"][row])
        map_rows(team, place.scene, size[:2], out["map"][row])


def bounded(found: Observation) -> Observation:
    """The arrays that are not empty, each clipped to [−1, 1] in place."""
    return {name: np.clip(array, -1.0, 1.0, out=array) for name, array in found.items() if array.size}


@njit(cache=True, nogil=True)
def _observe(rows, states, where, size, out):  # type: ignore[no-untyped-def]
    """Fill rows (n,) of the arrays of observations: robots, seen, map, beliefs.

    where: scene and extent (2, 2) m. size: cells, m of a cell, reach m.
    """
    robots, seen, maps, beliefs = out
    for n in rows:
        robot_rows(states.team[n], where[1], robots[n])
        _seen_rows(states.team[n], states.people[n], states.seen[n], size[2], seen[n])
        map_rows(states.team[n], where[0], size[:2], maps[n])
        _belief_rows((states.known[n], states.mean[n], states.covariance[n]), states.time_unseen[n], where[1], beliefs[n])


@njit(cache=True)
def _seen_rows(team, people, share, reach, out):  # type: ignore[no-untyped-def]
    """Fill the rows (r, p, 5) of `seen` in `space_of` for people (p, 4). share (r, p): visible share of each body."""
    for r in range(len(team)):
        for p in range(len(people)):
            if share[r, p] > 0:
                dx, dy = people[p, 0] - team[r, X], people[p, 1] - team[r, Y]
                azimuth = np.arctan2(dy, dx) - team[r, YAW]
                out[r, p, 0], out[r, p, 1], out[r, p, 2] = 1.0, np.cos(azimuth), np.sin(azimuth)
                out[r, p, 3], out[r, p, 4] = np.sqrt(dx * dx + dy * dy) / reach, share[r, p]


@njit(cache=True)
def _belief_rows(believed, unseen, extent, out):  # type: ignore[no-untyped-def]
    """Fill the rows (p, 9) of beliefs, as in `space_of`. believed: known (p,), mean (p, 4) and covariance. unseen (p,): s since last seen."""
    known, mean, P = believed
    for p in range(len(known)):
        if known[p] > 0:
            sx, sy = np.sqrt(max(P[p, 0, 0], 1e-9)), np.sqrt(max(P[p, 1, 1], 1e-9))
            out[p, 0], out[p, 8] = 1.0, unseen[p] / 30.0
            for k in range(2):
                out[p, 1 + k] = 2.0 * (mean[p, k] - extent[0, k]) / (extent[1, k] - extent[0, k]) - 1.0
                out[p, 3 + k] = mean[p, 2 + k] / SPEED_SCALE
            out[p, 5], out[p, 6], out[p, 7] = sx / SIGMA_SCALE, sy / SIGMA_SCALE, P[p, 0, 1] / (sx * sy)


@njit(cache=True, nogil=True)
def robot_rows(team, extent, out):  # type: ignore[no-untyped-def]
    """Fill the rows (r, 6) of robots of states team (r, 7), as in `space_of`. extent (2, 2) m."""
    for r in range(len(team)):
        for k in range(2):
            out[r, k] = 2.0 * (team[r, k] - extent[0, k]) / (extent[1, k] - extent[0, k]) - 1.0
        out[r, 2], out[r, 3] = np.cos(team[r, YAW]), np.sin(team[r, YAW])
        out[r, 4], out[r, 5] = team[r, SPEED] / TOP_SPEED, team[r, YAW_RATE] / TOP_YAW_RATE


@njit(cache=True, nogil=True)
def map_rows(team, scene, size, out):  # type: ignore[no-untyped-def]
    """Fill the local maps (r, 2, n, n) around robots team (r, 7), as in `space_of`. size: cells, m of a cell."""
    n, cell = size
    floor, top, frame = scene.floor, scene.top, scene.frame
    rows, columns = floor.shape
    for r in range(len(team)):
        cj = min(max(int((team[r, X] - frame[0]) / frame[2] + 0.5), 0), columns - 1)
        ci = min(max(int((team[r, Y] - frame[1]) / frame[2] + 0.5), 0), rows - 1)
        level = floor[ci, cj]
        for i in range(n):
            for j in range(n):
                x = team[r, X] + (j - 0.5 * (n - 1)) * cell
                y = team[r, Y] + (i - 0.5 * (n - 1)) * cell
                gj, gi = int(np.floor((x - frame[0]) / frame[2] + 0.5)), int(np.floor((y - frame[1]) / frame[2] + 0.5))
                if gi < 0 or gj < 0 or gi >= rows or gj >= columns:
                    # A cell outside the world counts as an obstacle.
                    out[r, 1, i, j] = 1.0
                    continue
                out[r, 0, i, j] = (floor[gi, gj] - level) / HEIGHT_SCALE
                out[r, 1, i, j] = (top[gi, gj] - floor[gi, gj]) / HEIGHT_SCALE
