"""What a robot measures at one tick, as one linear system in the joint state: the landmarks and the other robots its camera sees, and gravity."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tracker.ekf.measurement_models import gravity, jacobians, predict, residual, robot_jacobians
from tracker.ekf.state import JointState, Linear
from tracker.geometry import Array, Indices, Mask, exp_so3
from tracker.types import Mount, Odometry

Seen = tuple[Mount, Indices, Array, Array]
"""A camera, the landmarks (k,) that it sees, their bearings (k, 3) and covariances (k, 2, 2)."""


@dataclass(frozen=True, eq=False)
class RobotMeasurements:
    """Robots (j,) of the joint state that a camera sees: their numbers there, levers (j, 3) m, where their own cameras are in their bodies, bearings
    (j, 3) of these and covariances (j, 2, 2) rad².
    """

    mount: Mount
    other: Indices
    lever: Array
    bearing: Array
    covariance: Array

    def __len__(self) -> int:
        return len(self.other)

    def those(self, rows: Mask | Indices) -> RobotMeasurements:
        """Some of them, or all in another order."""
        return RobotMeasurements(self.mount, self.other[rows], self.lever[rows], self.bearing[rows], self.covariance[rows])


def linearise(joint: JointState, robot: int, seen: Seen | None, level: Odometry | None, met: RobotMeasurements | None = None) -> Linear:
    """Rows of landmarks, two each, then of other robots, then two of gravity where there is a level: "up" is one more direction."""
    own = joint.stride
    landmark = np.zeros(0, dtype=np.intp) if seen is None else seen[1]
    others = () if met is None else tuple(met.other.tolist())
    k, j = len(landmark), len(others)
    rows = k + j + (level is not None)
    H, r, noise = np.zeros((rows, 2, own + 3 * k + 6 * j)), np.zeros((rows, 2)), np.zeros((rows, 2, 2))
    if seen is not None and k:
        sight, point, at = joint.sight(robot, seen[0]), joint.point[landmark], np.arange(k)
        H_body, H_point, H_correction = jacobians(joint.sight(robot, seen[0], anchored=True), joint.anchors[2][landmark])
        H[:k, :, :6] = H_body
        if joint.corrected:
            H[:k, :, 6:9] = H_correction
        for axis in range(3):
            H[at, :, own + 3 * at + axis] = H_point[:, :, axis]
        r[:k], noise[:k] = residual(seen[2], predict(sight, point)[0]), seen[3]
    if met is not None and j:
        H[k : k + j], r[k : k + j] = _of_robots(joint, robot, met, 3 * k)
        noise[k : k + j] = met.covariance
    if level is not None and level.gravity is not None:
        up = level.gravity / np.linalg.norm(level.gravity)
        # What lasts of the error of "up" is a turn that the body seems to have in excess.
        tilt = exp_so3(-level.gravity_sigma * np.append(joint.lasting[robot, 6:], 0.0))
        r[-1], H[-1, :, :6] = gravity(joint.rotation[robot] @ tilt, up)[0], gravity(joint.anchors[0][robot] @ tilt, up)[1]
        if joint.persistent:
            H[-1, :, own - 2 : own] = -level.gravity_sigma * H[-1, :, 3:5]
        H[-1, :, 3:6] = H[-1, :, 3:6] @ tilt.T
        noise[-1] = np.eye(2) * level.gravity_sigma**2
    return Linear(robot, joint.columns(robot, landmark, others), H.reshape(2 * rows, H.shape[2]), r.reshape(-1), noise, others)


def _of_robots(joint: JointState, robot: int, met: RobotMeasurements, between: int) -> tuple[Array, Array]:
    """Rows (j, 2, c) and residuals (j, 2) of other robots; `between`: how many columns the landmarks have."""
    own, at = joint.stride, np.arange(len(met))
    first = joint.anchors[0][met.other], joint.anchors[1][met.other]
    H_body, H_correction, H_other = robot_jacobians(joint.sight(robot, met.mount, anchored=True), first, met.lever)
    H = np.zeros((len(met), 2, own + between + 6 * len(met)))
    H[:, :, :6] = H_body
    if joint.corrected:
        H[:, :, 6:9] = H_correction
    for axis in range(6):
        H[at, :, own + between + 6 * at + axis] = H_other[:, :, axis]
    places = joint.translation[met.other] + (joint.rotation[met.other] @ met.lever[..., None])[..., 0]
    return H, residual(met.bearing, predict(joint.sight(robot, met.mount), places)[0])
