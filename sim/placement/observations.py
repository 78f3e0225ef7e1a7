"""What a policy is shown: named arrays in [−1, 1], always of the same shapes."""

from __future__ import annotations

import numpy as np
from gymnasium import spaces
from numba import njit
from numpy.typing import NDArray

from sim.placement.config import SPEED, YAW, YAW_RATE, PlacementConfig
from sim.placement.episode import Episode
from sim.placement.map import PlacementMap
from sim.robots.driving import TOP_SPEED, TOP_YAW_RATE
from tracker.geometry import Array, wrap

SPREAD = 4.0
"""m: the standard deviation that counts as 1 in beliefs."""
PACE = 2.0
"""m/s: the speed that counts as 1 in beliefs."""
RELIEF = 2.0
"""m up and down that count as 1 in local maps."""
OWN, SEEN, BELIEF = 6, 5, 9
"""Numbers of a robot, of a person whom it sees, and of a belief."""

Arrays = dict[str, np.ndarray]


def space_of(config: PlacementConfig) -> spaces.Dict:
    """The space of `observe`.

    robots (r, 6): x, y over the extent, cos and sin of the heading, speed and turn over the highest.
    seen (r, p, 5): of the people whom a robot sees, 1 (else all is 0), cos and sin of their direction off its heading, distance over the reach, and
    how much of them shows; in the order of their numbers, but with observation "tracks" detections in the order of their directions.
    map (r, 2, n, n): terrain and what stands on it around a robot, heights over its own ground; rows to the north, columns to the east.
    beliefs (k, 9): 1 (else all is 0), x, y over the extent, velocity, standard deviations along x and y, their correlation, and s since seen over 30.
    panoramas (r · height, width, 3) uint8, robot under robot, only with observation "pixels".
    """
    r, n = config.robots, config.cells
    slots = config.people if config.observation != "tracks" else config.tracks
    shapes = {"robots": (r, OWN), "seen": (r, slots, SEEN), "map": (r, 2, n, n), "beliefs": (config.tracks, BELIEF)}
    boxes: dict[str, spaces.Space] = {name: spaces.Box(-1.0, 1.0, shape, np.float32) for name, shape in shapes.items() if np.prod(shape)}
    if config.observation == "pixels":
        boxes["panoramas"] = spaces.Box(0, 255, (r * config.width // 2, config.width, 3), np.uint8)
    return spaces.Dict(boxes)


def observe(episode: Episode) -> Arrays:
    """All arrays but panoramas."""
    config, place = episode.config, episode.place
    poses = episode.tracking.planar_poses() if episode.tracking is not None else episode.now.team[:, :3]
    out = {
        "robots": _own(place, poses, episode.now.team),
        "seen": _seen(episode) if episode.tracking is None else episode.tracking.seen(),
        "map": local_maps(place, poses[:, :2], config),
        "beliefs": _beliefs(episode),
    }
    return {name: np.clip(array, -1.0, 1.0).astype(np.float32) for name, array in out.items() if array.size}


def _own(place: PlacementMap, poses: Array, team: Array) -> Array:
    out = np.empty((len(poses), OWN))
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
    out, config = np.zeros((episode.config.tracks, BELIEF)), episode.config
    if episode.tracking is not None:
        position, P = episode.tracking.position[: config.tracks], episode.tracking.covariance[: config.tracks]
        rows: NDArray[np.int64] = np.arange(len(position), dtype=np.int64)
        velocity, age = np.zeros((len(position), 2)), np.zeros(len(position))
    else:
        rows = np.flatnonzero(episode.beliefs.known).astype(np.int64)
        position, velocity = episode.beliefs.mean[rows, :2], episode.beliefs.mean[rows, 2:]
        P, age = episode.beliefs.covariance[rows, :2, :2], episode.unseen[rows]
    sigma = np.sqrt(np.maximum(P[:, [0, 1], [0, 1]], 1e-9))
    out[rows, 0] = 1.0
    out[rows, 1:3] = episode.place.normalised(position)
    out[rows, 3:5] = velocity / PACE
    out[rows, 5:7] = sigma / SPREAD
    out[rows, 7] = P[:, 0, 1] / sigma.prod(axis=1)
    out[rows, 8] = age / 30.0
    return out


def local_maps(place: PlacementMap, centres: Array, config: PlacementConfig) -> Array:
    """(r, 2, n, n): as in `space_of`, around centres (r, 2) m."""
    return _local_maps(place.floor.heights, place.heights.top, place.heights.frame, np.ascontiguousarray(centres), (config.cells, config.cell))


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
                    # The world ends there: nothing to be seen, no way out.
                    out[r, 1, i, j] = 1.0
                    continue
                out[r, 0, i, j] = (floor[gi, gj] - level) / RELIEF
                out[r, 1, i, j] = (top[gi, gj] - floor[gi, gj]) / RELIEF
    return out
