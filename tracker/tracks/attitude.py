"""Attitude of moving robots, corrected by the people whom they see.

A roll or pitch that is wrong by 0.1° moves a person at 23 m by about a meter, and moves all people of a view together. Tracks follow from the views
of several robots, so that they tell what the errors of one view have in common. Before boxes are placed on the ground, the attitude of their robot
is corrected by its maximum a posteriori estimate. The prior is that of SLAM, and the measurements are the directions to the feet of people.
Poses that are reported are those of SLAM.
"""

from __future__ import annotations

import numpy as np

from tracker.geometry import Array, Ints, Pose, angles_from_bearing, bearing_from_angles, exp_so3, wrap
from tracker.tracks.parameters import MhtParameters
from tracker.tracks.tracks import Places
from tracker.types import Setup, View

GATE = 3.0
"""Standard deviations within which a box is of a person, where each is the nearest of the other."""
FREEDOM = 4.0
"""Degrees of freedom of Student's t distribution of directions: boxes may end above the feet, or be of other people."""
REWEIGHTINGS = 4
"""Iterations of least squares, each with weights by the residuals of the one before (Lange, Little, Taylor 1989)."""
NEAREST = 1.0
"""Least distance of people who count, m."""


def corrected_pose(setup: Setup, pose: tuple[Pose, Array], view: View, people: Places, parameters: MhtParameters) -> tuple[Pose, Array]:
    """The pose of a robot with the attitude that a view of its camera shows, given where n people are expected at that time.

    pose: T_world_robot, and the covariance (6, 6) of its right tangent. In the new covariance, attitude and place are independent.
    """
    (T_world_robot, P), detections = pose, view.detections
    if not P[3:, 3:].any():
        return pose
    T_world_camera, R = T_world_robot @ setup.mounts[view.camera].T_body_camera, T_world_robot.rotation
    prior = R @ P[3:, 3:] @ R.T
    seen = np.arange(len(detections)) if detections.feet_seen is None else np.flatnonzero(detections.feet_seen)
    across, up = angles_from_bearing(detections.bearing[seen])
    feet = bearing_from_angles(across, up - detections.extent[seen, 1] / 2) @ T_world_camera.rotation.T
    found, noise = np.stack(angles_from_bearing(feet), axis=1), np.diagonal(detections.covariance[seen], axis1=1, axis2=2)
    expected, variance = _directions(setup, T_world_camera.translation, people, parameters)
    apart = wrap(found[None] - expected[:, None])
    spread = variance[:, None] + noise[None] + np.array([prior[2, 2], (prior[0, 0] + prior[1, 1]) / 2])
    i, d = _pairs((apart**2 / spread).sum(axis=2))
    if not len(i):
        return pose
    azimuth, zero = expected[i, 0], np.zeros(len(i))
    # Directions change by turn × direction; elevations of feet are small.
    H = np.concatenate([np.stack([zero, zero, zero + 1], axis=1), np.stack([np.sin(azimuth), -np.cos(azimuth), zero], axis=1)])
    residual, S = apart[i, d].T.ravel(), (variance[i] + noise[d]).T.ravel()
    turn, posterior = np.zeros(3), prior
    for _ in range(REWEIGHTINGS):
        rest = residual - H @ turn
        weight = (FREEDOM + 1) / (FREEDOM + rest**2 / S) / S
        posterior = np.linalg.solve(np.eye(3) + prior @ H.T @ (weight[:, None] * H), prior)
        turn = posterior @ H.T @ (weight * residual)
    covariance = np.zeros((6, 6))
    covariance[:3, :3], covariance[3:, 3:] = P[:3, :3], R.T @ posterior @ R
    return Pose(exp_so3(-turn) @ R, T_world_robot.translation), (covariance + covariance.T) / 2


def _directions(setup: Setup, origin: Array, people: Places, parameters: MhtParameters) -> tuple[Array, Array]:
    """Azimuth and elevation (n, 2) rad of the feet of people farther than NEAREST from `origin` (3,) m, and their variances (n, 2) rad²."""
    rays = np.column_stack([people.mean, setup.ground.height_at(people.mean)]) - origin
    # Soles end before the middle of the body.
    distance = np.hypot(rays[:, 0], rays[:, 1]) - parameters.fusion.ahead
    far = distance > NEAREST
    rays, distance, covariance = rays[far], distance[far], people.covariance[far] + parameters.motion.foot_spread**2 * np.eye(2)
    angles = np.stack([np.arctan2(rays[:, 1], rays[:, 0]), np.arctan2(rays[:, 2], distance)], axis=1)
    along = np.stack([np.cos(angles[:, 0]), np.sin(angles[:, 0])], axis=1)
    left = np.stack([-along[:, 1], along[:, 0]], axis=1)
    variance = np.stack([np.einsum("ni,nij,nj->n", axis, covariance, axis) for axis in (left, along)], axis=1)
    # Elevation changes by sin / distance of a move along the line of sight.
    return angles, variance / distance[:, None] ** 2 * np.stack([np.ones(len(rays)), np.sin(angles[:, 1]) ** 2], axis=1)


def _pairs(distance: Array) -> tuple[Ints, Ints]:
    """Rows and columns of the pairs within GATE of which each is the nearest of the other; distance (n, m): squared."""
    if not distance.size:
        return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)
    rows, nearest = np.arange(len(distance)), distance.argmin(axis=1)
    good = (distance[rows, nearest] < GATE**2) & (distance.argmin(axis=0)[nearest] == rows)
    return rows[good], nearest[good]
