"""The walking body: proportions, limbs, clothes, and the pose of every limb.

Lengths are shares of stature after Drillis & Contini (1966), Body segment parameters, as reprinted in Winter (2009), Biomechanics and Motor
Control of Human Movement, fig. 4.1. A limb's frame has its origin in the joint nearer to the trunk and is x forward, y left, z up when a
person stands upright.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from sim import gait
from sim.gait import Footing, Terrain
from tracker.geometry import Array, frozen

THIGH, SHIN, ANKLE = 0.245, 0.246, 0.039
"""Hip to knee, knee to ankle, ankle to sole."""
HIP_HEIGHT, SHOULDER_HEIGHT, CHIN_HEIGHT = 0.530, 0.818, 0.870
UPPER_ARM, FOREARM, HAND = 0.186, 0.146, 0.108
HALF_HIPS, HALF_SHOULDERS = 0.050, 0.107
"""Half the distance of the hip joints and of the shoulder joints (the outer shoulder is at 0.129)."""
HEEL, PIVOT = 0.040, 0.095
"""From the ankle back to the heel and forward to where the shoe rolls off: the foot is 0.152 long."""
RADIUS = 0.22
"""m: the upright capsule that robots run into."""

LIMBS = (
    "pelvis", "torso", "head", "left_upper_arm", "right_upper_arm", "left_forearm", "right_forearm",
    "left_thigh", "right_thigh", "left_shin", "right_shin", "left_shoe", "right_shoe",
)  # fmt: skip
"""The limbs in the order of every array of poses; each is a mocap body `person_7/head`."""
COCO = (
    "nose", "left_eye", "right_eye", "left_ear", "right_ear", "left_shoulder", "right_shoulder", "left_elbow", "right_elbow",
    "left_wrist", "right_wrist", "left_hip", "right_hip", "left_knee", "right_knee", "left_ankle", "right_ankle",
)  # fmt: skip
"""The order of key points (Lin et al. 2014, COCO)."""

_SIDES = np.array([1.0, -1.0])
_FACE = np.array([[0.058, 0.0, 0.108], [0.048, 0.018, 0.124], [0.048, -0.018, 0.124], [0.0, 0.043, 0.117], [0.0, -0.043, 0.117]])
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
        object.__setattr__(self, "joints", frozen(self.joints, (None, len(COCO), 3), "joints"))


def statures(rng: np.random.Generator, n: int) -> Array:
    """Body heights (n,) m of adults: normal 1.72 ± 0.09 m, drawn again outside of [1.5, 2.0]."""
    out = rng.normal(1.72, 0.09, n)
    while ((out < 1.5) | (out > 2.0)).any():
        out = np.where((out < 1.5) | (out > 2.0), rng.normal(1.72, 0.09, n), out)
    return out


def pose(stature: Array, footing: Footing, position: Array, heading: Array, ground: Terrain) -> Poses:
    """The limbs of m people of stature (m,) m whose middle is over position (m, 2) m, heading (m,) rad, with these feet on that ground.

    Legs are two links from hip to ankle (law of cosines), the pelvis is as high as both legs reach, and pelvis, shoulders and arms swing with
    the distance between the feet: who stands hangs the arms.
    """
    feet = _feet(stature, footing, position, heading, ground)
    forward = np.stack([np.cos(heading), np.sin(heading)], axis=1)
    # How far the right foot is ahead of the left one, as an angle of the legs.
    stagger = np.einsum("mi,mi->m", feet.ankle[:, 1, :2] - feet.ankle[:, 0, :2], forward) / (2 * (THIGH + SHIN) * stature)
    pelvis_turn = _rotation("zx", np.stack([heading + 0.25 * stagger, 0.0 * stagger], axis=1))
    hip_offset = pelvis_turn[:, None, :, 1] * (_SIDES[:, None] * (HALF_HIPS * stature)[:, None, None])
    pelvis = np.column_stack([position, _pelvis_height(stature, feet.ankle, footing.swing, position[:, None] + hip_offset[..., :2])])
    hips = pelvis[:, None] + hip_offset
    feet = _within_reach(stature, hips, feet)
    knees, thighs, shins = _legs(stature, hips, feet)
    lean = 0.03 + 0.12 * np.abs(stagger)
    torso_turn = _rotation("zy", np.stack([heading - 0.3 * stagger, lean], axis=1))
    shoulders_middle = pelvis + torso_turn[:, :, 2] * ((SHOULDER_HEIGHT - HIP_HEIGHT) * stature)[:, None]
    shoulders = shoulders_middle[:, None] + torso_turn[:, None, :, 1] * (_SIDES[:, None] * (HALF_SHOULDERS * stature)[:, None, None])
    upper, fore = _arms(heading, stagger)
    elbows = shoulders - upper[..., 2] * (UPPER_ARM * stature)[:, None, None]
    wrists = elbows - fore[..., 2] * (FOREARM * stature)[:, None, None]
    head_turn = _rotation("zy", np.stack([heading, 0.4 * lean], axis=1))
    face = shoulders_middle[:, None] + np.einsum("mij,kj->mki", head_turn, _FACE) * stature[:, None, None]
    origins = [pelvis[:, None], pelvis[:, None], shoulders_middle[:, None], shoulders, elbows, hips, knees, feet.ankle]
    turns = [pelvis_turn[:, None], torso_turn[:, None], head_turn[:, None], upper, fore, thighs, shins, feet.rotation]
    rotation = np.concatenate(turns, axis=1)
    quaternion = Rotation.from_matrix(rotation.reshape(-1, 3, 3)).as_quat(scalar_first=True).reshape(-1, len(LIMBS), 4)
    joints = np.concatenate([face, shoulders, elbows, wrists, hips, knees, feet.ankle], axis=1)
    return Poses(np.concatenate(origins, axis=1), quaternion, joints)


@dataclass(frozen=True, eq=False)
class _Feet:
    """ankle (m, 2, 3) m and rotation (m, 2, 3, 3) of the shoes, world frame."""

    ankle: Array
    rotation: Array


def _feet(stature: Array, footing: Footing, position: Array, heading: Array, ground: Terrain) -> _Feet:
    """Shoes on the ground or in the air between two footfalls; they roll over the heel when they land and over the toes when they leave."""
    place, yaw = gait.places(footing)
    here, landing, leaving = (
        _contact(p, y, stature, ground) for p, y in ((place, yaw), (footing.planted, footing.planted_yaw), (footing.lifted, footing.lifted_yaw))
    )
    share = (footing.swing**2 * (3 - 2 * footing.swing))[..., None]
    moving = ~footing.standing[..., None]
    # heel, toe and tilt of the sole on the ground, or on the line between footfalls, but never below the ground
    sole = np.where(moving, leaving + share * (landing - leaving), here)
    arc = gait.lift(footing, stature)[..., None]
    sink = np.maximum((here - sole)[..., :2].max(axis=-1, keepdims=True) + 0.3 * arc, 0.0) * moving
    sole = sole + (np.maximum(arc, np.minimum(sink, 0.5)) * np.array([1.0, 1.0, 0.0]))
    roll_off = _roll(footing, place, position, heading, stature)
    length = (HEEL + PIVOT) * stature[:, None]
    slope = -np.arctan2(sole[..., 1] - sole[..., 0], length)
    forward = np.stack([np.cos(yaw), np.sin(yaw), np.zeros_like(yaw)], axis=-1)
    heel = np.concatenate([place, sole[..., :1]], axis=-1) - forward * (HEEL * stature)[:, None, None]
    flat = _rotation("zyx", np.stack([yaw, slope, sole[..., 2]], axis=-1))
    turned = _rotation("zyx", np.stack([yaw, slope + roll_off, sole[..., 2]], axis=-1))
    size = stature[:, None, None]
    toe = heel + flat[..., 0] * length[..., None]
    over_heel = heel + turned @ np.array([HEEL, 0.0, ANKLE]) * size
    over_toe = toe + turned @ np.array([-PIVOT, 0.0, ANKLE]) * size
    return _Feet(np.where((roll_off > 0)[..., None], over_toe, over_heel), turned)


def _contact(place: Array, yaw: Array, stature: Array, ground: Terrain) -> Array:
    """(m, 2, 3): the ground's height m under heel and toe, and its tilt to the left rad, where feet (m, 2, 2) stand flat."""
    forward = np.stack([np.cos(yaw), np.sin(yaw)], axis=-1)
    left = np.stack([-forward[..., 1], forward[..., 0]], axis=-1)
    size = stature[:, None, None]
    points = np.stack([place - HEEL * size * forward, place + PIVOT * size * forward, place + 0.04 * left, place - 0.04 * left], axis=2)
    height = ground.height_at(points.reshape(-1, 2)).reshape(points.shape[:3])
    return np.stack([height[..., 0], height[..., 1], np.clip(np.arctan2(height[..., 2] - height[..., 3], 0.08), -0.4, 0.4)], axis=-1)


def _roll(footing: Footing, place: Array, position: Array, heading: Array, stature: Array) -> Array:
    """(m, 2) rad by which the toes are down (the body has left the foot behind) or up (the foot is ahead)."""
    forward = np.stack([np.cos(heading), np.sin(heading)], axis=1)

    def of(feet: Array) -> Array:
        ahead = np.einsum("mfi,mi->mf", position[:, None] - feet, forward) / stature[:, None]
        down, up = np.clip((ahead - 0.09) / 0.22, 0.0, 1.0), np.clip((-ahead - 0.08) / 0.10, 0.0, 1.0)
        return 0.95 * down**1.5 - 0.33 * up

    share = footing.swing**2 * (3 - 2 * footing.swing)
    return np.where(footing.standing, of(footing.planted), (1 - share) * of(footing.lifted) + share * of(place))


def _pelvis_height(stature: Array, ankle: Array, swing: Array, hips: Array) -> Array:
    """(m,) m: the height at which both legs reach their ankles (m, 2, 3) from hips over (m, 2, 2) m, hardly bent.

    A foot in the middle of its swing does not hold the body down.
    """
    leg = 0.993 * (THIGH + SHIN) * stature[:, None]
    across = np.linalg.norm(hips - ankle[..., :2], axis=2)
    reach = ankle[..., 2] + np.sqrt(np.maximum(leg**2 - across**2, (0.4 * leg) ** 2))
    return (reach + stature[:, None] * np.clip(3 * np.minimum(swing, 1 - swing), 0.0, 1.0)).min(axis=1)


def _within_reach(stature: Array, hips: Array, feet: _Feet) -> _Feet:
    """The feet with ankles that a leg does not reach drawn up to the hip."""
    down = feet.ankle - hips
    length = np.linalg.norm(down, axis=2)
    share = np.minimum(1.0, 0.999 * (THIGH + SHIN) * stature[:, None] / length)
    return _Feet(hips + share[..., None] * down, feet.rotation)


def _legs(stature: Array, hips: Array, feet: _Feet) -> tuple[Array, Array, Array]:
    """Knees (m, 2, 3) m, rotations of thighs and shins (m, 2, 3, 3): two links, the knee to the front, between foot and hip."""
    thigh, shin = THIGH * stature[:, None], SHIN * stature[:, None]
    down = feet.ankle - hips
    length = np.linalg.norm(down, axis=2)
    along = down / length[..., None]
    front = _across(feet.rotation[..., 0], along)
    reach = np.minimum(length, 0.9995 * (thigh + shin))
    cosine = np.clip((thigh**2 + reach**2 - shin**2) / (2 * thigh * reach), -1.0, 1.0)
    knees = hips + thigh[..., None] * (cosine[..., None] * along + np.sqrt(1 - cosine**2)[..., None] * front)
    return knees, _limb(hips - knees, front), _limb(knees - feet.ankle, front)


def _arms(heading: Array, stagger: Array) -> tuple[Array, Array]:
    """Rotations of upper arms and forearms (m, 2, 3, 3): each arm swings with the other side's leg, the elbow bends on the way forward."""
    swing = 0.95 * stagger[:, None] * _SIDES
    bend = 0.18 + 0.4 * np.maximum(swing, 0.0) + 0.3 * np.abs(stagger[:, None])
    away = np.broadcast_to(0.09 * _SIDES, swing.shape)
    yaw = np.repeat(heading[:, None], 2, axis=1)
    return _rotation("zyx", np.stack([yaw, -swing, away], axis=-1)), _rotation("zyx", np.stack([yaw, -swing - bend, 0.5 * away], axis=-1))


def _rotation(axes: str, angles: Array) -> Array:
    """Rotations (..., 3, 3) about the body's own axes one after the other, angles (..., k) rad."""
    flat = angles.reshape(-1, angles.shape[-1])
    if not len(flat):
        return np.zeros((*angles.shape[:-1], 3, 3))
    return Rotation.from_euler(axes.upper(), flat).as_matrix().reshape(*angles.shape[:-1], 3, 3)


def _across(direction: Array, axis: Array) -> Array:
    """The part of `direction` across the unit `axis`, of length 1."""
    rest = direction - np.einsum("...i,...i->...", direction, axis)[..., None] * axis
    return rest / np.maximum(np.linalg.norm(rest, axis=-1), 1e-9)[..., None]


def _limb(up: Array, front: Array) -> Array:
    """Rotations (..., 3, 3) with z along `up` and x towards `front`."""
    z = up / np.maximum(np.linalg.norm(up, axis=-1), 1e-9)[..., None]
    x = _across(front, z)
    return np.stack([x, np.cross(z, x), z], axis=-1)
