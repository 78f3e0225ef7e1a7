"""Skeleton of a pedestrian: proportions, statures, and the poses of all limbs and key points, of people who walk, stand or sit.

Lengths are shares of stature after Drillis & Contini (1966), Body segment parameters, reprinted in Winter (2009), Biomechanics and Motor
Control of Human Movement, fig. 4.1. The origin of a limb's frame is the joint nearer to the trunk.
Its axes are x forward, y left, z up when the person stands upright.

People who sit have their thighs on the seat, shins upright where the feet reach the ground, and forearms over thighs or table. Walking people look
ahead, standing people at the nearest person or robot. The speed of a head is that of gaze shifts (Freedman & Sparks 1997: up to some 150 °/s),
its range that of a neck (±70°).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from sim.pedestrian import leg_kinematics
from sim.pedestrian.foot_contact import ANKLE, Feet, foot_poses, rotation_matrices
from sim.pedestrian.gait import Bodies, Footing, Terrain
from sim.pedestrian.leg_kinematics import SHIN, THIGH
from tracker.geometry import Array, Ints, frozen, rotation_z, wrap
from tracker.types import KEYPOINT_NAMES

HIP_HEIGHT, SHOULDER_HEIGHT = 0.530, 0.818
UPPER_ARM, FOREARM, HAND = 0.186, 0.146, 0.108
HALF_HIPS, HALF_SHOULDERS = 0.050, 0.107
"""Half the distance between the hip joints and between the shoulder joints (the outer shoulder is at 0.129)."""
CHILDREN, ADULTS = (1.1, 1.5), (1.5, 2.0)
"""m: lowest and highest statures."""
RADIUS = 0.22
"""m: radius of the upright capsule that robots collide with."""

LIMBS = (
    "pelvis", "torso", "head", "left_upper_arm", "right_upper_arm", "left_forearm", "right_forearm",
    "left_thigh", "right_thigh", "left_shin", "right_shin", "left_shoe", "right_shoe",
)  # fmt: skip
"""Limbs in the order of all arrays of poses; each is a mocap body such as `person_7/head`."""

_SIDES = np.array([1.0, -1.0])
_FACE = np.array([[0.070, 0.0, 0.103], [0.053, 0.018, 0.124], [0.053, -0.018, 0.124], [0.0, 0.046, 0.117], [0.0, -0.046, 0.117]])
"""Nose, eyes and ears in the head's frame, shares of stature. The head's origin is between the shoulders."""


@dataclass(frozen=True, eq=False)
class Poses:
    """Limbs of m people: position (m, limbs, 3) m, quaternion (m, limbs, 4) wxyz, joints (m, 17, 3) m in the order of KEYPOINT_NAMES; world frame."""

    position: Array
    quaternion: Array
    joints: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "position", frozen(self.position, (None, len(LIMBS), 3), "position"))
        object.__setattr__(self, "quaternion", frozen(self.quaternion, (None, len(LIMBS), 4), "quaternion"))
        object.__setattr__(self, "joints", frozen(self.joints, (None, len(KEYPOINT_NAMES), 3), "joints"))


def statures(rng: np.random.Generator, n: int, children: float = 0.0) -> Array:
    """Random statures (n,) m. Adults: normal 1.72 ± 0.09 m, truncated to [1.5, 2.0]. A share `children`: 1.1 to 1.5 m (5 to 11 years)."""
    out = rng.normal(1.72, 0.09, n)
    while ((out < 1.5) | (out > 2.0)).any():
        out = np.where((out < 1.5) | (out > 2.0), rng.normal(1.72, 0.09, n), out)
    return np.where(rng.random(n) < children, rng.uniform(*CHILDREN, n), out) if children else out


def head_size(stature: Array) -> Array:
    """Stature (m,) m of an adult with the same head and neck as people of stature (m,) m.

    The head (vertex to menton) is 0.165 of the stature of a child of 1.1 m, and 0.130 of that of an adult: 1.27 times the share
    (Snyder et al. 1977, Anthropometry of Infants, Children and Youths to Age 18). The share falls to the adult's at 1.5 m.
    """
    return stature * np.interp(stature, [1.1, 1.5], [1.27, 1.0])


def trunk_size(stature: Array) -> Array:
    """Stature (m,) m of an adult with the same shoulder height. Children have a larger head, hence shorter trunk and legs."""
    return (stature - (1 - SHOULDER_HEIGHT) * head_size(stature)) / SHOULDER_HEIGHT


@dataclass(frozen=True, eq=False)
class UpperBody:
    """Rotations of torso and head (m, 3, 3), and of upper arms and forearms, two arrays (m, 2, 3, 3)."""

    torso: Array
    head: Array
    arms: tuple[Array, Array]


Legs = tuple[tuple[Array, Array, Feet], tuple[Array, Array, Array]]
"""Hips and knees (m, 2, 3) m and the feet; rotations of the pelvis (m, 3, 3), of thighs and of shins (m, 2, 3, 3)."""


def limb_poses(stature: Array, footing: Footing, position: Array, heading: Array, ground: Terrain) -> Poses:
    """Poses of the limbs of m people of stature (m,) m at position (m, 2) m with heading (m,) rad, with these footfalls on that ground.

    Legs are solved by leg_kinematics.py. Pelvis, shoulders and arms swing with the distance between the feet.
    """
    size = trunk_size(stature)
    feet = foot_poses(size, footing, position, heading, ground)
    forward = np.stack([np.cos(heading), np.sin(heading)], axis=1)
    # Lead of the right foot over the left one, as an angle of the legs.
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
    upper = UpperBody(torso_turn, rotation_matrices(heading, 0.4 * lean, none), _arms(heading, stagger))
    return assembled(stature, pelvis, upper, ((hips, knees, feet), (pelvis_turn, thighs, shins)))


def assembled(stature: Array, pelvis: Array, upper_body: UpperBody, legs: Legs) -> Poses:
    """Poses of m people of stature (m,) m from the position of the pelvis (m, 3) m, the rotations of the upper body, and the legs."""
    size = trunk_size(stature)
    (hips, knees, feet), (pelvis_turn, thighs, shins) = legs
    torso_turn, head_turn, (upper, fore) = upper_body.torso, upper_body.head, upper_body.arms
    shoulders_middle = pelvis + torso_turn[:, :, 2] * ((SHOULDER_HEIGHT - HIP_HEIGHT) * size)[:, None]
    shoulders = shoulders_middle[:, None] + torso_turn[:, None, :, 1] * (_SIDES[:, None] * (HALF_SHOULDERS * size)[:, None, None])
    elbows = shoulders - upper[..., 2] * (UPPER_ARM * size)[:, None, None]
    wrists = elbows - fore[..., 2] * (FOREARM * size)[:, None, None]
    face = shoulders_middle[:, None] + np.einsum("mij,kj->mki", head_turn, _FACE) * head_size(stature)[:, None, None]
    origins = [pelvis[:, None], pelvis[:, None], shoulders_middle[:, None], shoulders, elbows, hips, knees, feet.ankle]
    turns = [pelvis_turn[:, None], torso_turn[:, None], head_turn[:, None], upper, fore, thighs, shins, feet.rotation]
    rotation = np.concatenate(turns, axis=1)
    quaternion = Rotation.from_matrix(rotation.reshape(-1, 3, 3)).as_quat(scalar_first=True).reshape(-1, len(LIMBS), 4)
    joints = np.concatenate([face, shoulders, elbows, wrists, hips, knees, feet.ankle], axis=1)
    return Poses(np.concatenate(origins, axis=1), quaternion, joints)


def _arms(heading: Array, stagger: Array) -> tuple[Array, Array]:
    """Rotations of upper arms and forearms (m, 2, 3, 3). An arm swings with the opposite leg, and its elbow bends in front."""
    swing = 0.95 * stagger[:, None] * _SIDES
    bend = 0.18 + 0.4 * np.maximum(swing, 0.0) + 0.3 * np.abs(stagger[:, None])
    away = np.broadcast_to(0.09 * _SIDES, swing.shape)
    yaw = np.repeat(heading[:, None], 2, axis=1)
    return rotation_matrices(yaw, -swing, away), rotation_matrices(yaw, -swing - bend, 0.5 * away)


HIP_ABOVE_SEAT, KNEE_ABOVE_SEAT = 0.062, 0.0
"""Heights of the hip joints, and least height of the knees, above a seat, shares of stature. The knees are beyond its front edge."""
PELVIS_TILT, TRUNK_LEAN = -0.9, 0.05
"""rad about the left axis: the pelvis rolls back by half of the 90° between thighs and trunk; the trunk leans forward a little."""
ARM_SWING, ELBOW_BEND, ARMS_AWAY = 0.35, 0.87, 0.10
"""rad: upper arms forward, elbows bent, both arms aside."""
KNEES_APART = 0.012
"""Distance of the feet outward of the hips, a share of stature."""


@dataclass(frozen=True, eq=False)
class SittingManner:
    """How m people sit. lean, turn (m,) rad: of the trunk forward and to the left. nod (m,) rad: of the head forward.

    swing, bend (m, 2) rad: upper arms forward, and elbows bent, left and right.
    """

    lean: Array
    turn: Array
    nod: Array
    swing: Array
    bend: Array

    @staticmethod
    def usual(m: int) -> SittingManner:
        """Upright, with the hands before the belly."""
        return SittingManner(np.full(m, TRUNK_LEAN), np.zeros(m), np.zeros(m), np.full((m, 2), ARM_SWING), np.full((m, 2), ELBOW_BEND))

    @staticmethod
    def drawn(m: int, rng: np.random.Generator) -> SittingManner:
        """Leaning back or over the table, arms hanging, on the table, raised or at the head, looking down at something or ahead."""
        return SittingManner(
            rng.choice([rng.uniform(-0.25, 0.15, m), rng.uniform(0.1, 0.6, m)]),
            rng.normal(0.0, 0.3, m),
            np.where(rng.random(m) < 0.35, rng.uniform(0.1, 0.7, m), rng.normal(0.0, 0.1, m)),
            np.where(rng.random((m, 2)) < 0.12, rng.uniform(1.0, 2.4, (m, 2)), rng.uniform(0.0, 0.9, (m, 2))),
            rng.uniform(0.2, 2.1, (m, 2)),
        )


def sitting_poses(stature: Array, seat: Array, ground: Terrain, manner: SittingManner | None = None) -> Poses:
    """Poses of m people of stature (m,) m on seats (m, 4): x, y and height m of the seat, and heading rad. manner: None for SittingManner.usual."""
    size, heading, manner = trunk_size(stature), seat[:, 3], manner or SittingManner.usual(len(stature))
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
    turned = heading + manner.turn
    yaw, away = np.repeat(turned[:, None], 2, axis=1), np.broadcast_to(ARMS_AWAY * _SIDES, manner.swing.shape)
    arms = rotation_matrices(yaw, -manner.swing, away), rotation_matrices(yaw, -manner.swing - manner.bend, 0.3 * away)
    upper = UpperBody(rotation_matrices(turned, manner.lean, none), rotation_matrices(turned, manner.nod, none), arms)
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


FASTEST_TURN, LARGEST_TURN = 2.5, 1.2
"""rad/s and rad: speed and range of a head about the vertical axis."""
GAZE_RANGE = 8.0
"""m: range within which people look at others."""
STANDING_SPEED = 0.25
"""m/s: speed below which a person counts as standing."""
_FACE_JOINTS = slice(0, 5)


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
    joints[:, _FACE_JOINTS] = origin + (joints[:, _FACE_JOINTS] - origin) @ (before @ after.transpose(0, 2, 1))
    return replace(poses, quaternion=quaternion, joints=joints)
