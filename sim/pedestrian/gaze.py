"""Where people look: ahead as they walk, and at whoever is near when they stand.

The head turns as fast as in gaze shifts to what one wants to see (Freedman & Sparks 1997: up to some 150 °/s) and as far as a neck does (±70°).
"""

from __future__ import annotations

import dataclasses

import numpy as np
from scipy.spatial.transform import Rotation

from sim.pedestrian.gait import Bodies
from sim.pedestrian.skeleton import LIMBS, Poses
from tracker.geometry import Array, rotation_z, wrap

FASTEST_TURN, LARGEST_TURN = 2.5, 1.2
"""rad/s and rad."""
GAZE_RANGE = 8.0
"""m: what is farther off is not looked at."""
STANDING_SPEED = 0.25
"""m/s: who is slower looks around."""
_FACE = slice(0, 5)


def head_yaw(yaw: Array, bodies: Bodies, points: Array, dt: float) -> Array:
    """How far heads are turned to the left (m,) rad, `dt` s after they were at `yaw` (m,).

    Who stands turns it to the nearest of points (k, 2) m that a neck can turn to.
    """
    if not len(points):
        wanted = np.zeros_like(yaw)
    else:
        away = points - bodies.position[:, None]
        angle = wrap(np.arctan2(away[..., 1], away[..., 0]) - bodies.heading[:, None])
        distance = np.hypot(away[..., 0], away[..., 1])
        # Oneself is among the points.
        distance = np.where((distance < 0.1) | (np.abs(angle) > LARGEST_TURN), np.inf, distance)
        nearest = distance.argmin(axis=1)[:, None]
        sees = (np.take_along_axis(distance, nearest, axis=1)[:, 0] < GAZE_RANGE) & (np.hypot(*bodies.velocity.T) < STANDING_SPEED)
        wanted = np.where(sees, np.take_along_axis(angle, nearest, axis=1)[:, 0], 0.0)
    return yaw + np.clip(wanted - yaw, -FASTEST_TURN * dt, FASTEST_TURN * dt)


def with_head_yaw(poses: Poses, yaw: Array) -> Poses:
    """The poses with the heads turned by yaw (m,) rad about their own upright axes, faces with them."""
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
