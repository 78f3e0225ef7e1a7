"""Poses of people who sit: thighs on the seat, shins upright where the feet reach the ground, forearms over thighs or table."""

from __future__ import annotations

import numpy as np

from sim.pedestrian import leg_kinematics
from sim.pedestrian.foot_contact import ANKLE, Feet, rotation_matrices
from sim.pedestrian.gait import Terrain
from sim.pedestrian.leg_kinematics import SHIN, THIGH
from sim.pedestrian.skeleton import HALF_HIPS, Poses, UpperBody, assembled, trunk_size
from tracker.geometry import Array, Ints

HIP_ABOVE_SEAT, KNEE_ABOVE_SEAT = 0.062, 0.0
"""Heights of the hip joints, and least height of the knees, above a seat, shares of stature. The knees are beyond its front edge."""
PELVIS_TILT, TRUNK_LEAN = -0.9, 0.05
"""rad about the left axis: the pelvis rolls back by half of the 90° between thighs and trunk; the trunk leans forward a little."""
ARM_SWING, ELBOW_BEND, ARMS_AWAY = 0.35, 0.87, 0.10
"""rad: upper arms forward, elbows bent, both arms aside."""
KNEES_APART = 0.012
"""Distance of the feet outward of the hips, a share of stature."""
_SIDES = np.array([1.0, -1.0])


def sitting_poses(stature: Array, seat: Array, ground: Terrain) -> Poses:
    """Poses of m people of stature (m,) m on seats (m, 4): x, y and height m of the seat, and heading rad."""
    size, heading = trunk_size(stature), seat[:, 3]
    none = np.zeros_like(heading)
    facing = rotation_matrices(heading, none, none)
    forward, left = facing[:, None, :, 0], facing[:, None, :, 1] * _SIDES[:, None]
    hip_height = seat[:, 2] + HIP_ABOVE_SEAT * size
    pelvis = np.column_stack([seat[:, :2], hip_height])
    hips = pelvis[:, None] + left * (HALF_HIPS * size)[:, None, None]
    thigh, shin = THIGH * size, SHIN * size
    # Feet hang where they do not reach the ground.
    out = hips + left * (KNEES_APART * size)[:, None, None] + forward * thigh[:, None, None]
    floor = ground.height_at(out[..., :2].reshape(-1, 2)).reshape(-1, 2)
    knee_height = np.maximum(floor + (ANKLE * size + shin)[:, None], (seat[:, 2] + KNEE_ABOVE_SEAT * size)[:, None])
    reach = np.sqrt(np.maximum(thigh[:, None] ** 2 - (hip_height[:, None] - knee_height) ** 2, (0.3 * thigh[:, None]) ** 2))
    ankle = hips + left * (KNEES_APART * size)[:, None, None] + forward * reach[..., None]
    ankle[..., 2] = knee_height - shin[:, None]
    feet = Feet(ankle, np.repeat(facing[:, None], 2, axis=1), ankle, np.zeros((len(size), 2)), ankle)
    knees, thighs, shins = leg_kinematics.solve_knees(size, hips, feet)
    swing = np.full((len(size), 2), ARM_SWING)
    yaw, away = np.repeat(heading[:, None], 2, axis=1), np.broadcast_to(ARMS_AWAY * _SIDES, swing.shape)
    arms = rotation_matrices(yaw, -swing, away), rotation_matrices(yaw, -swing - ELBOW_BEND, 0.3 * away)
    upper = UpperBody(rotation_matrices(heading, none + TRUNK_LEAN, none), facing, arms)
    legs = (hips, knees, feet), (rotation_matrices(heading, none + PELVIS_TILT, none), thighs, shins)
    return assembled(stature, pelvis, upper, legs)


def with_sitters(poses: Poses, sitter: Ints, seated: Poses) -> Poses:
    """The poses with those of people sitter (k,) replaced by the rows of `seated`."""
    parts = []
    for name in ("position", "quaternion", "joints"):
        values = getattr(poses, name).copy()
        values[sitter] = getattr(seated, name)
        parts.append(values)
    return Poses(*parts)
