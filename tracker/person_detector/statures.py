"""Boxes that could be of a person who stands on the ground, by the calibration of the camera."""

from __future__ import annotations

import numpy as np

from tracker.geometry import Array, Mask, Pose
from tracker.geometry.cameras import Camera
from tracker.geometry.ground import Ground
from tracker.person_detector.found_boxes import FoundBoxes

STATURE = (1.0, 2.3)
"""m: from a child, or a person who sits, to the tallest."""
REACH = 200.0
"""m: farther feet are at the horizon, where no stature can be told."""
EDGE_SHARE, EDGE_PIXELS = 0.04, 1.5
"""Standard deviation of an edge where the network gives none: a share of the box's height, and px."""
WITHIN = 2.0
"""Standard deviations by which the edges may be off."""


def could_stand(found: FoundBoxes, camera: Camera, pose: Pose, ground: Ground) -> Mask:
    """Whether each box (n,) could be of a person of STATURE on the ground. pose: T_world_camera.

    The edges may be off by WITHIN standard deviations. A box that the image cuts may go on there.
    """
    left, top, width, height = found.box.T
    sigma = EDGE_SHARE * height + EDGE_PIXELS if found.sigma is None else found.sigma[:, 3]
    middle, bottom = left + width / 2, top + height
    margin = WITHIN * sigma
    tallest = _stature(camera, pose, ground, (middle, bottom + margin, top - margin))
    shortest = _stature(camera, pose, ground, (middle, bottom - margin, top + margin))
    # A lower foot is nearer, so that the same rows are less of a body: the box itself and both moves together are tried, too.
    others = [_stature(camera, pose, ground, (middle, bottom + a * margin, top + b * margin)) for a, b in ((0, 0), (1, 1), (-1, -1))]
    all_ = np.stack([tallest, shortest, *others])
    low, high = np.min(all_, axis=0), np.max(all_, axis=0)
    cut_below, cut_above = bottom >= camera.height - 1, top <= 1
    return np.asarray((cut_below | cut_above | (high >= STATURE[0])) & (cut_below | (low <= STATURE[1])))


def _stature(camera: Camera, pose: Pose, ground: Ground, box: tuple[Array, Array, Array]) -> Array:
    """Height (n,) m of upright bodies with feet and heads at pixels; ∞ where the feet are not on the ground. box: column, feet, heads (n,) px."""
    column, feet, heads = box
    foot, head = (camera.bearings_from_pixels(np.stack([column, rows], axis=1)) @ pose.rotation.T for rows in (feet, heads))
    origin = np.broadcast_to(pose.translation, foot.shape)
    point, there = ground.intersect(origin, foot, REACH)
    distance = np.hypot(*(point - origin)[:, :2].T)
    along = np.maximum(np.hypot(head[:, 0], head[:, 1]), 1e-9)
    height = origin[:, 2] - point[:, 2] + distance * head[:, 2] / along
    return np.asarray(np.where(there, height, np.inf))
