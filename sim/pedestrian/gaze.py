"""Gaze: walking people look ahead, standing people look at the nearest person or robot.

The speed of a head is that of gaze shifts (Freedman & Sparks 1997: up to some 150 °/s), its range that of a neck (±70°).
"""

from __future__ import annotations

import dataclasses

import numpy as np
from scipy.spatial.transform import Rotation

from sim.pedestrian.gait import Bodies
from sim.pedestrian.skeleton import LIMBS, Poses
from tracker.geometry import Array, rotation_z, wrap

FASTEST_TURN, LARGEST_TURN = 2.5, 1.2
"""rad/s and rad: speed and range of a head about the vertical axis."""
GAZE_RANGE = 8.0
"""m: range within which people look at others."""
STANDING_SPEED = 0.25
"""m/s: speed below which a person counts as standing."""
_FACE = slice(0, 5)


def head_yaw(yaw: Array, bodies: Bodies, points: Array, dt: float) -> Array:
    """Yaw (m,) rad of the heads to the left of the bodies, `dt` s after it was `yaw` (m,).

    Standing people turn towards the nearest of points (k, 2) m within the range of the neck, others look ahead.
    """
    if not len(points):
        wanted = np.zeros_like(yaw)
    else:
        away = points - bodies.position[:, None]
        angle = wrap(np.arctan2(away[..., 1], away[..., 0]) - bodies.heading[:, None])
        distance = np.hypot(away[..., 0], away[..., 1])
        # The points include the person itself.
        distance = np.where((distance < 0.1) | (np.abs(angle) > LARGEST_TURN), np.inf, distance)
        nearest = distance.argmin(axis=1)[:, None]
        sees = (np.take_along_axis(distance, nearest, axis=1)[:, 0] < GAZE_RANGE) & (np.hypot(*bodies.velocity.T) < STANDING_SPEED)
        wanted = np.where(sees, np.take_along_axis(angle, nearest, axis=1)[:, 0], 0.0)
    return yaw + np.clip(wanted - yaw, -FASTEST_TURN * dt, FASTEST_TURN * dt)


def with_head_yaw(poses: Poses, yaw: Array) -> Poses:
    """The poses with heads and faces rotated by yaw (m,) rad about the heads' own z axes."""
    if not len(yaw):
        return poses
    head = LIMBS.index("head")
    before = Rotation.from_quat(poses.quaternion[:, head], scalar_first=True).as_matrix()
    after = before @ np.stack([rotation_z(angle) for angle in yaw])
    quaternion, joints = poses.quaternion.copy(), poses.joints.copy()
    quaternion[:, head] = Rotation.from_matrix(after).as_quat(scalar_first=True)
    origin = poses.position[:, head, None]
    joints[:, _FACE] = origin + (joints[:, _FACE] - origin) @ (before @ after.transpose(0, 2, 1))
    return dataclasses.replace(poses, quaternion=quaternion, joints=joints)
