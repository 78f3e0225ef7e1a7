"""Map accuracy where true landmarks are known: the true landmark of each sighting, and the score of a tracker's map."""

from __future__ import annotations

import numpy as np

from sim.stress.trial_data import TrialData
from tracker.geometry import Array, Ints, Pose
from tracker.metrics.landmark_map import MapScore, score_map
from tracker.metrics.trajectory import align
from tracker.sequence.results import Results
from tracker.types import Sightings

MAX_ANGLE = np.radians(1.0)
"""Largest angle between a sighting and its landmark, rad."""
MIN_SIGHTINGS = 5
"""A landmark should be in the map after this number of sightings by one robot."""


def true_landmarks(landmarks: Array, T_world_camera: Pose, seen: Sightings) -> Ints:
    """(n,) the landmark nearest in direction to each sighting, at most one sighting a landmark; −1 beyond MAX_ANGLE.

    landmarks: (m, 3) m, world frame.
    """
    direction = landmarks - T_world_camera.translation
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    cosine = seen.bearing @ T_world_camera.rotation.T @ direction.T
    best = cosine.argmax(axis=1)
    good = cosine[np.arange(len(best)), best] > np.cos(MAX_ANGLE)
    _, first = np.unique(best, return_index=True)
    once = np.zeros(len(best), dtype=bool)
    once[first] = True
    return np.where(good & once, best, -1)


def map_score(data: TrialData, results: Results) -> MapScore | None:
    """The score of the final map against the true landmarks that one robot saw MIN_SIGHTINGS times.

    The map is aligned by the alignment of the robots' paths. None where true landmarks are not known, and where the tracker reports no map.
    """
    if data.landmarks is None or results.landmark_history is None:
        return None
    seen = {robot: np.zeros(len(data.landmarks), dtype=np.int64) for robot in data.setup.starts}
    for tick, truth in zip(data.ticks, data.truth, strict=True):
        for view in tick.views:
            mount = data.setup.mounts[view.camera]
            if view.sightings is not None and len(view.sightings) and mount.robot in truth.T_world_robot:
                found = true_landmarks(data.landmarks, truth.T_world_robot[mount.robot] @ mount.T_body_camera, view.sightings)
                seen[mount.robot][found[found >= 0]] += 1
    wanted = np.max(list(seen.values()), axis=0) >= MIN_SIGHTINGS
    pairs = [
        (pose.translation, t.T_world_robot[robot].translation)
        for robot, poses in results.poses.items()
        for pose, t in zip(poses, data.truth, strict=True)
        if pose is not None and robot in t.T_world_robot
    ]
    given, true = np.array(pairs).reshape(-1, 2, 3).swapaxes(0, 1)
    return score_map(data.landmarks, results.landmark_history.map, wanted, align(given, true) if pairs else None)
