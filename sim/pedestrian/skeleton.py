"""The walking body: proportions, limbs, clothes, and the pose of every limb.

Lengths are shares of stature after Drillis & Contini (1966), Body segment parameters, as reprinted in Winter (2009), Biomechanics and Motor
Control of Human Movement, fig. 4.1. A limb's frame has its origin in the joint nearer to the trunk and is x forward, y left, z up when a
person stands upright.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from sim.pedestrian import leg_kinematics
from sim.pedestrian.foot_contact import foot_poses, rotation_matrices
from sim.pedestrian.gait import Footing, Terrain
from sim.pedestrian.leg_kinematics import SHIN, THIGH
from tracker.geometry import Array, frozen
from tracker.types import KEYPOINT_NAMES

HIP_HEIGHT, SHOULDER_HEIGHT = 0.530, 0.818
UPPER_ARM, FOREARM, HAND = 0.186, 0.146, 0.108
HALF_HIPS, HALF_SHOULDERS = 0.050, 0.107
"""Half the distance of the hip joints and of the shoulder joints (the outer shoulder is at 0.129)."""
CHILDREN, ADULTS = (1.1, 1.5), (1.5, 2.0)
"""m: the lowest and the highest statures."""
RADIUS = 0.22
"""m: the upright capsule that robots run into."""

LIMBS = (
    "pelvis", "torso", "head", "left_upper_arm", "right_upper_arm", "left_forearm", "right_forearm",
    "left_thigh", "right_thigh", "left_shin", "right_shin", "left_shoe", "right_shoe",
)  # fmt: skip
"""The limbs in the order of every array of poses; each is a mocap body `person_7/head`."""

_SIDES = np.array([1.0, -1.0])
_FACE = np.array([[0.070, 0.0, 0.103], [0.053, 0.018, 0.124], [0.053, -0.018, 0.124], [0.0, 0.046, 0.117], [0.0, -0.046, 0.117]])
"""Nose, eyes and ears in the head's frame, shares of stature; the head's origin is between the shoulders."""


@dataclass(frozen=True, eq=False)
class Poses:
    """The limbs of m people: position (m, limbs, 3) m and quaternion (m, limbs, 4) wxyz, world frame; joints (m, 17, 3) m in the order of COCO."""

    position: Array
    quaternion: Array
    joints: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "position", frozen(self.position, (None, len(LIMBS), 3), "position"))
        object.__setattr__(self, "quaternion", frozen(self.quaternion, (None, len(LIMBS), 4), "quaternion"))
        object.__setattr__(self, "joints", frozen(self.joints, (None, len(KEYPOINT_NAMES), 3), "joints"))


def statures(rng: np.random.Generator, n: int, children: float = 0.0) -> Array:
    """Body heights (n,) m of adults: normal 1.72 ± 0.09 m, drawn again outside of [1.5, 2.0]; a share of `children`, 1.1 to 1.5 m (5 to 11 years)."""
    out = rng.normal(1.72, 0.09, n)
    while ((out < 1.5) | (out > 2.0)).any():
        out = np.where((out < 1.5) | (out > 2.0), rng.normal(1.72, 0.09, n), out)
    return np.where(rng.random(n) < children, rng.uniform(*CHILDREN, n), out) if children else out


def head_size(stature: Array) -> Array:
    """(m,) m: the stature of the adult whose head, neck included, is as large as that of people of stature (m,) m.

    The head of a child of 1.1 m is 1.27 times as large a share of it as an adult's (0.165 against 0.130, vertex to menton, after Snyder et al. 1977,
    Anthropometry of Infants, Children and Youths to Age 18); from there to 1.5 m the share falls to that of an adult.
    """
    return stature * np.interp(stature, [1.1, 1.5], [1.27, 1.0])


def trunk_size(stature: Array) -> Array:
    """(m,) m: the stature of the adult whose body below the shoulders is as large: what the head takes, trunk and legs lack."""
    return (stature - (1 - SHOULDER_HEIGHT) * head_size(stature)) / SHOULDER_HEIGHT


def limb_poses(stature: Array, footing: Footing, position: Array, heading: Array, ground: Terrain) -> Poses:
    """The limbs of m people of stature (m,) m whose middle is over position (m, 2) m, heading (m,) rad, with these feet on that ground.

    Legs are two links from hip to ankle (legs.py), and pelvis, shoulders and arms swing with the distance between the feet: who stands hangs
    the arms.
    """
    size = trunk_size(stature)
    feet = foot_poses(size, footing, position, heading, ground)
    forward = np.stack([np.cos(heading), np.sin(heading)], axis=1)
    # How far the right foot is ahead of the left one, as an angle of the legs.
    stagger = np.einsum("mi,mi->m", feet.ankle[:, 1, :2] - feet.ankle[:, 0, :2], forward) / (2 * (THIGH + SHIN) * size)
    none = np.zeros_like(heading)
    pelvis_turn = rotation_matrices(heading + 0.25 * stagger, none, none)
    hip_offset = pelvis_turn[:, None, :, 1] * (_SIDES[:, None] * (HALF_HIPS * size)[:, None, None])
    pelvis = np.column_stack([position, leg_kinematics.hip_height(size, feet, footing, position[:, None] + hip_offset[..., :2])])
    hips = pelvis[:, None] + hip_offset
    feet = leg_kinematics.raise_heels(size, hips, feet)
    knees, thighs, shins = leg_kinematics.solve_knees(size, hips, feet)
    lean = 0.03 + 0.12 * np.abs(stagger)
    torso_turn = rotation_matrices(heading - 0.3 * stagger, lean, none)
    shoulders_middle = pelvis + torso_turn[:, :, 2] * ((SHOULDER_HEIGHT - HIP_HEIGHT) * size)[:, None]
    shoulders = shoulders_middle[:, None] + torso_turn[:, None, :, 1] * (_SIDES[:, None] * (HALF_SHOULDERS * size)[:, None, None])
    upper, fore = _arms(heading, stagger)
    elbows = shoulders - upper[..., 2] * (UPPER_ARM * size)[:, None, None]
    wrists = elbows - fore[..., 2] * (FOREARM * size)[:, None, None]
    head_turn = rotation_matrices(heading, 0.4 * lean, none)
    face = shoulders_middle[:, None] + np.einsum("mij,kj->mki", head_turn, _FACE) * head_size(stature)[:, None, None]
    origins = [pelvis[:, None], pelvis[:, None], shoulders_middle[:, None], shoulders, elbows, hips, knees, feet.ankle]
    turns = [pelvis_turn[:, None], torso_turn[:, None], head_turn[:, None], upper, fore, thighs, shins, feet.rotation]
    rotation = np.concatenate(turns, axis=1)
    quaternion = Rotation.from_matrix(rotation.reshape(-1, 3, 3)).as_quat(scalar_first=True).reshape(-1, len(LIMBS), 4)
    joints = np.concatenate([face, shoulders, elbows, wrists, hips, knees, feet.ankle], axis=1)
    return Poses(np.concatenate(origins, axis=1), quaternion, joints)


def _arms(heading: Array, stagger: Array) -> tuple[Array, Array]:
    """Rotations of upper arms and forearms (m, 2, 3, 3): each arm swings with the other side's leg, the elbow bends on the way forward."""
    swing = 0.95 * stagger[:, None] * _SIDES
    bend = 0.18 + 0.4 * np.maximum(swing, 0.0) + 0.3 * np.abs(stagger[:, None])
    away = np.broadcast_to(0.09 * _SIDES, swing.shape)
    yaw = np.repeat(heading[:, None], 2, axis=1)
    return rotation_matrices(yaw, -swing, away), rotation_matrices(yaw, -swing - bend, 0.5 * away)
