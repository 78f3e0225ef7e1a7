"""What a robot measures at one tick, as one linear system in the joint state: the landmarks its camera sees, and gravity."""

from __future__ import annotations

import numpy as np

from tracker.bearings import gravity, jacobians, predict, residual
from tracker.geometry import Array, exp_so3
from tracker.joint import Indices, Joint, Linear
from tracker.measurements import Mount, Odometry

Seen = tuple[Mount, Indices, Array, Array]
"""A camera, the landmarks (k,) that it sees, their bearings (k, 3) and covariances (k, 2, 2)."""


def linearise(joint: Joint, robot: int, seen: Seen | None, level: Odometry | None) -> Linear:
    """Rows of landmarks, two each, then two of gravity where there is a level: "up" is one more direction."""
    own = joint.stride
    landmark = np.zeros(0, dtype=np.intp) if seen is None else seen[1]
    k = len(landmark)
    H, r, noise = np.zeros((k + 1, 2, own + 3 * k)), np.zeros((k + 1, 2)), np.zeros((k + 1, 2, 2))
    if seen is not None and k:
        sight, point, at = joint.sight(robot, seen[0]), joint.point[landmark], np.arange(k)
        H_body, H_point, H_correction = jacobians(joint.sight(robot, seen[0], anchored=True), joint.anchors[2][landmark])
        H[:k, :, :6] = H_body
        if joint.corrected:
            H[:k, :, 6:9] = H_correction
        for axis in range(3):
            H[at, :, own + 3 * at + axis] = H_point[:, :, axis]
        r[:k], noise[:k] = residual(seen[2], predict(sight, point)[0]), seen[3]
    if level is not None and level.gravity is not None:
        up = level.gravity / np.linalg.norm(level.gravity)
        # What lasts of the error of "up" is a turn that the body seems to have in excess.
        tilt = exp_so3(-level.gravity_sigma * np.append(joint.lasting[robot, 6:], 0.0))
        r[k], H[k, :, :6] = gravity(joint.rotation[robot] @ tilt, up)[0], gravity(joint.anchors[0][robot] @ tilt, up)[1]
        if joint.persistent:
            H[k, :, own - 2 : own] = -level.gravity_sigma * H[k, :, 3:5]
        H[k, :, 3:6] = H[k, :, 3:6] @ tilt.T
        noise[k] = np.eye(2) * level.gravity_sigma**2
    rows = k + (level is not None)
    return Linear(robot, joint.columns(robot, landmark), H[:rows].reshape(2 * rows, -1), r[:rows].reshape(-1), noise[:rows])
