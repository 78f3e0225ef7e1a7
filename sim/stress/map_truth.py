"""Landmarks of footage whose places are known: whose each sighting is, which could be mapped, and how good a tracker's map is."""

from __future__ import annotations

import numpy as np

from sim.stress.footage import TrialData
from tracker.geometry import Array, Ints, Pose
from tracker.metrics.landmark_map import MapScore, score_map
from tracker.metrics.trajectory import align
from tracker.sequence.results import Results
from tracker.types import Sightings

SAME = np.radians(1.0)
"""rad between a sighting and a landmark that it can be of."""
OFTEN = 5
"""Sightings by one robot after which a landmark should be in a map."""


def whose(landmarks: Array, T_world_camera: Pose, seen: Sightings) -> Ints:
    """(n,) the landmark nearest in direction, each at most once, −1 where none is near: a sighting that strays tells nothing."""
    way = landmarks - T_world_camera.translation
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    cosine = seen.bearing @ T_world_camera.rotation.T @ way.T
    best = cosine.argmax(axis=1)
    good = cosine[np.arange(len(best)), best] > np.cos(SAME)
    _, first = np.unique(best, return_index=True)
    once = np.zeros(len(best), dtype=bool)
    once[first] = True
    return np.where(good & once, best, -1)


def map_score(footage: TrialData, results: Results) -> MapScore | None:
    """The map at the end beside the true landmarks that one robot saw OFTEN, moved as one with the team; None where no true ones are known, or
    the tracker tells of no map.
    """
    if footage.landmarks is None or results.survey is None:
        return None
    seen = {robot: np.zeros(len(footage.landmarks), dtype=np.int64) for robot in footage.setup.starts}
    for tick, truth in zip(footage.ticks, footage.truth, strict=True):
        for view in tick.views:
            mount = footage.setup.mounts[view.camera]
            if view.sightings is not None and len(view.sightings) and mount.robot in truth.T_world_robot:
                found = whose(footage.landmarks, truth.T_world_robot[mount.robot] @ mount.T_body_camera, view.sightings)
                seen[mount.robot][found[found >= 0]] += 1
    wanted = np.max(list(seen.values()), axis=0) >= OFTEN
    pairs = [
        (pose.translation, t.T_world_robot[robot].translation)
        for robot, poses in results.poses.items()
        for pose, t in zip(poses, footage.truth, strict=True)
        if pose is not None and robot in t.T_world_robot
    ]
    given, true = np.array(pairs).reshape(-1, 2, 3).swapaxes(0, 1)
    return score_map(footage.landmarks, results.survey.map, wanted, align(given, true) if pairs else None)
