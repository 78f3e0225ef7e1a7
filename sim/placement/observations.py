"""Observations of a policy: named arrays in [−1, 1] of fixed shapes."""

from __future__ import annotations

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from sim.placement.config import SPEED, YAW, YAW_RATE, PlacementConfig
from sim.placement.episode import Episode
from sim.placement.map import PlacementMap
from sim.robots.driving import TOP_SPEED, TOP_YAW_RATE
from tracker.geometry import Array, wrap
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
      correlation, and the time since the person was seen over 30 s.
    * panoramas (r · height, width, 3) uint8: one robot below the other, only with observation "pixels".
    """
    r, n = config.robots, config.cells
    slots = config.people if config.observation != "tracks" else config.max_tracks
    shapes = {"robots": (r, ROBOT_FEATURES), "seen": (r, slots, SEEN_FEATURES), "map": (r, 2, n, n), "beliefs": (config.max_tracks, BELIEF_FEATURES)}
    boxes: dict[str, spaces.Space] = {name: spaces.Box(-1.0, 1.0, shape, np.float32) for name, shape in shapes.items() if np.prod(shape)}
    if config.observation == "pixels":
        boxes["panoramas"] = spaces.Box(0, 255, (r * config.width // 2, config.width, 3), np.uint8)
    return spaces.Dict(boxes)


def observe(episode: Episode) -> Observation:
    """All arrays of the observation except panoramas."""
    config, place = episode.config, episode.place
    poses = episode.tracking.planar_poses() if episode.tracking is not None else episode.now.team[:, :3]
    out = {
        "robots": _robots(place, poses, episode.now.team),
        "seen": _seen(episode) if episode.tracking is None else episode.tracking.detection_rows(),
        "map": local_maps(place, poses[:, :2], config),
        "beliefs": _beliefs(episode),
    }
    return {name: np.clip(array, -1.0, 1.0).astype(np.float32) for name, array in out.items() if array.size}


def _robots(place: PlacementMap, poses: Array, team: Array) -> Array:
    out = np.empty((len(poses), ROBOT_FEATURES))
    out[:, :2] = place.normalised(poses[:, :2])
    out[:, 2], out[:, 3] = np.cos(poses[:, YAW]), np.sin(poses[:, YAW])
    out[:, 4], out[:, 5] = team[:, SPEED] / TOP_SPEED, team[:, YAW_RATE] / TOP_YAW_RATE
    return out


def _seen(episode: Episode) -> Array:
    now = episode.now
    away = now.people[None, :, :2] - now.team[:, None, :2]
    azimuth = wrap(np.arctan2(away[..., 1], away[..., 0]) - now.team[:, None, YAW])
    distance = np.hypot(away[..., 0], away[..., 1]) / episode.config.reach
    out = np.stack([np.ones_like(azimuth), np.cos(azimuth), np.sin(azimuth), distance, now.seen], axis=2)
    return out * (now.seen > 0)[:, :, None]


def _beliefs(episode: Episode) -> Array:
    out, config = np.zeros((episode.config.max_tracks, BELIEF_FEATURES)), episode.config
    if episode.tracking is not None:
        position, P = episode.tracking.position[: config.max_tracks], episode.tracking.covariance[: config.max_tracks]
        rows: NDArray[np.int64] = np.arange(len(position), dtype=np.int64)
        velocity, age = np.zeros((len(position), 2)), np.zeros(len(position))
    else:
        rows = np.flatnonzero(episode.beliefs.known).astype(np.int64)
        position, velocity = episode.beliefs.mean[rows, :2], episode.beliefs.mean[rows, 2:]
        P, age = episode.beliefs.covariance[rows, :2, :2], episode.time_unseen[rows]
    sigma = np.sqrt(np.maximum(P[:, [0, 1], [0, 1]], 1e-9))
    out[rows, 0] = 1.0
    out[rows, 1:3] = episode.place.normalised(position)
    out[rows, 3:5] = velocity / SPEED_SCALE
    out[rows, 5:7] = sigma / SIGMA_SCALE
    out[rows, 7] = P[:, 0, 1] / sigma.prod(axis=1)
    out[rows, 8] = age / 30.0
    return out


def local_maps(place: PlacementMap, centres: Array, config: PlacementConfig) -> Array:
    """Local maps (r, 2, n, n) around centres (r, 2) m, as in `space_of`."""
    return _local_maps(place.floor.heights, place.elevation.top, place.elevation.frame, np.ascontiguousarray(centres), (config.cells, config.cell))


@njit(cache=True)
def _local_maps(floor, top, frame, centres, size):  # type: ignore[no-untyped-def]
    n, cell = size
    rows, columns = floor.shape
    out = np.zeros((len(centres), 2, n, n))
    for r in range(len(centres)):
        cj = min(max(int((centres[r, 0] - frame[0]) / frame[2] + 0.5), 0), columns - 1)
        ci = min(max(int((centres[r, 1] - frame[1]) / frame[2] + 0.5), 0), rows - 1)
        level = floor[ci, cj]
        for i in range(n):
            for j in range(n):
                x = centres[r, 0] + (j - 0.5 * (n - 1)) * cell
                y = centres[r, 1] + (i - 0.5 * (n - 1)) * cell
                gj, gi = int(np.floor((x - frame[0]) / frame[2] + 0.5)), int(np.floor((y - frame[1]) / frame[2] + 0.5))
                if gi < 0 or gj < 0 or gi >= rows or gj >= columns:
                    # A cell outside the world counts as an obstacle.
                    out[r, 1, i, j] = 1.0
                    continue
                out[r, 0, i, j] = (floor[gi, gj] - level) / HEIGHT_SCALE
                out[r, 1, i, j] = (top[gi, gj] - floor[gi, gj]) / HEIGHT_SCALE
    return out
