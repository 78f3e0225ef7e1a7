"""All measurements of one robot at one tick as one linear system: bearings of landmarks and of other robots, and gravity."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tracker.ekf.measurement_models import gravity, jacobians, predict, residual, robot_jacobians
from tracker.ekf.odometry_biases import MOTION_BIASES
from tracker.ekf.state import JointState, LinearizedMeasurement
from tracker.geometry import Array, Indices, Mask, exp_so3
from tracker.types import Mount, Odometry

LandmarkMeasurement = tuple[Mount, Indices, Array, Array]
"""A camera, the landmarks (k,) that it sees, their bearings (k, 3) and covariances (k, 2, 2) rad²."""


@dataclass(frozen=True, eq=False)
class RobotMeasurements:
    """Bearings of other robots' cameras, j in all.

    other (j,): numbers of the robots in the joint state. lever (j, 3) m: their cameras in their bodies. bearing (j, 3) unit, in the frame
    of the camera `mount`, and covariance (j, 2, 2) rad².
    """

    mount: Mount
    other: Indices
    lever: Array
    bearing: Array
    covariance: Array

    def __len__(self) -> int:
        return len(self.other)

    def subset(self, rows: Mask | Indices) -> RobotMeasurements:
        """The given rows, in the given order."""
        return RobotMeasurements(self.mount, self.other[rows], self.lever[rows], self.bearing[rows], self.covariance[rows])


def linearize(
    joint: JointState, robot: int, seen: LandmarkMeasurement | None, odometry: Odometry | None, robots_seen: RobotMeasurements | None = None
) -> LinearizedMeasurement:
    """The linear system of one robot's measurements: two rows per landmark, then two per robot seen, then two of gravity.

    odometry: its measured "up" is one more direction; None where there is none. Residuals are at the means, Jacobians at the
    linearization points of the state.
    """
    own = joint.stride
    landmark = np.zeros(0, dtype=np.intp) if seen is None else seen[1]
    others = () if robots_seen is None else tuple(robots_seen.other.tolist())
    k, j = len(landmark), len(others)
    rows = k + j + (odometry is not None)
    H, r, noise = np.zeros((rows, 2, own + 3 * k + 6 * j)), np.zeros((rows, 2)), np.zeros((rows, 2, 2))
    if seen is not None and k:
        camera, point, at = joint.camera_pose(robot, seen[0]), joint.point[landmark], np.arange(k)
        H_body, H_point, H_correction = jacobians(joint.camera_pose(robot, seen[0], for_jacobians=True), joint.linearization_points.point[landmark])
        H[:k, :, :6] = H_body
        if joint.has_correction:
            H[:k, :, 6:9] = H_correction
        for axis in range(3):
            H[at, :, own + 3 * at + axis] = H_point[:, :, axis]
        r[:k], noise[:k] = residual(seen[2], predict(camera, point)[0]), seen[3]
    if robots_seen is not None and j:
        H[k : k + j], r[k : k + j] = _linearize_robots(joint, robot, robots_seen, 3 * k)
        noise[k : k + j] = robots_seen.covariance
    if odometry is not None and odometry.gravity is not None:
        up = odometry.gravity / np.linalg.norm(odometry.gravity)
        # The bias of "up" acts as an additional rotation of the body.
        tilt = exp_so3(-odometry.gravity_sigma * np.append(joint.odometry_bias[robot, MOTION_BIASES:], 0.0))
        r[-1], H[-1, :, :6] = gravity(joint.rotation[robot] @ tilt, up)[0], gravity(joint.linearization_points[0][robot] @ tilt, up)[1]
        if joint.has_odometry_bias:
            H[-1, :, own - 2 : own] = -odometry.gravity_sigma * H[-1, :, 3:5]
        H[-1, :, 3:6] = H[-1, :, 3:6] @ tilt.T
        noise[-1] = np.eye(2) * odometry.gravity_sigma**2
    return LinearizedMeasurement(joint.columns(robot, landmark, others), H.reshape(2 * rows, H.shape[2]), r.reshape(-1), noise)


def _linearize_robots(joint: JointState, robot: int, robots_seen: RobotMeasurements, landmark_columns: int) -> tuple[Array, Array]:
    """Rows (j, 2, c) and residuals (j, 2) of other robots; landmark_columns: the number of columns of landmarks."""
    own, at = joint.stride, np.arange(len(robots_seen))
    first = joint.linearization_points[0][robots_seen.other], joint.linearization_points[1][robots_seen.other]
    H_body, H_correction, H_other = robot_jacobians(joint.camera_pose(robot, robots_seen.mount, for_jacobians=True), first, robots_seen.lever)
    H = np.zeros((len(robots_seen), 2, own + landmark_columns + 6 * len(robots_seen)))
    H[:, :, :6] = H_body
    if joint.has_correction:
        H[:, :, 6:9] = H_correction
    for axis in range(6):
        H[at, :, own + landmark_columns + 6 * at + axis] = H_other[:, :, axis]
    places = joint.translation[robots_seen.other] + (joint.rotation[robots_seen.other] @ robots_seen.lever[..., None])[..., 0]
    return H, residual(robots_seen.bearing, predict(joint.camera_pose(robot, robots_seen.mount), places)[0])
