"""Umbrellas that people carry: their shape, the raised arm, and the place in the right hand. An umbrella is no part of the body."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from sim.pedestrian.foot_contact import rotation_matrices
from sim.pedestrian.skeleton import FOREARM, LIMBS, UPPER_ARM, Poses, trunk_size
from tracker.geometry import Array, Ints
from tracker.types import KEYPOINT_NAMES
from worlds.engine import mujoco
from worlds.props.shapes import Shape, revolved
from worlds.textures.furniture_atlas import Surface

KIND = "umbrella"
"""Bodies and geoms are named umbrella1, umbrella2, …, by the person's id."""
RADIUS, RIM, TOP = 0.50, 0.56, 0.76
"""m: radius of the canopy, and heights of its rim and its top above the hand."""
RAISED_UPPER_ARM, RAISED_FOREARM, AWAY = 0.5, 2.75, -0.12
"""rad: angles of the right upper arm and forearm from hanging down, forwards, and aside."""
HAND_CENTRE = 0.045
"""Distance from the wrist to the fist, a share of stature."""
COLOURS = ((0.04, 0.04, 0.05), (0.05, 0.07, 0.16), (0.10, 0.10, 0.11), (0.30, 0.05, 0.06), (0.08, 0.22, 0.14), (0.60, 0.58, 0.54), (0.65, 0.45, 0.08))
_UPPER, _FORE = LIMBS.index("right_upper_arm"), LIMBS.index("right_forearm")
_SHOULDER, _ELBOW, _WRIST = (KEYPOINT_NAMES.index(f"right_{name}") for name in ("shoulder", "elbow", "wrist"))


def add_umbrella(spec: mujoco.MjSpec, name: str, rng: np.random.Generator) -> None:
    """Add an umbrella as a mocap body and geom of that name. Its origin is in the hand, its z axis along the shaft."""
    shell = [(RADIUS * np.cos(a), RIM + (TOP - RIM) * np.sin(a)) for a in np.linspace(0, np.pi / 2 - 0.02, 6)]
    outer = revolved(rng, Surface.DARK, shell)
    inner = revolved(rng, Surface.DARK, [(r, z - 0.008) for r, z in shell])
    shaft = revolved(rng, Surface.DARK, [(0.012, -0.08), (0.012, 0.02), (0.006, 0.03), (0.006, TOP + 0.04)])
    shape: Shape = outer + replace(inner, faces=inner.faces[:, ::-1]) + shaft
    mesh = spec.add_mesh(name=name, uservert=shape.vertices.ravel(), userface=shape.faces.ravel())
    mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_CONVEX
    body = spec.worldbody.add_body(name=name, mocap=True)
    rgba = [*COLOURS[int(rng.integers(len(COLOURS)))], 1.0]
    body.add_geom(name=name, type=mujoco.mjtGeom.mjGEOM_MESH, meshname=name, rgba=rgba, contype=0, conaffinity=0, group=2)


def with_raised_arms(poses: Poses, holders: Ints, stature: Array, heading: Array) -> Poses:
    """The poses of m people of stature (m,) m and heading (m,) rad, in which holders (k,) have the right arm raised."""
    size, yaw = trunk_size(stature[holders]), heading[holders]
    none = np.zeros_like(yaw)
    upper, fore = rotation_matrices(yaw, none - RAISED_UPPER_ARM, none + AWAY), rotation_matrices(yaw, none - RAISED_FOREARM, none)
    position, quaternion, joints = poses.position.copy(), poses.quaternion.copy(), poses.joints.copy()
    elbow = joints[holders, _SHOULDER] - upper[:, :, 2] * (UPPER_ARM * size)[:, None]
    joints[holders, _ELBOW], position[holders, _FORE] = elbow, elbow
    joints[holders, _WRIST] = elbow - fore[:, :, 2] * (FOREARM * size)[:, None]
    for limb, turn in ((_UPPER, upper), (_FORE, fore)):
        quaternion[holders, limb] = Rotation.from_matrix(turn).as_quat(scalar_first=True).reshape(-1, 4)
    return Poses(position, quaternion, joints)


def umbrella_places(position: Array, quaternion: Array, stature: Array) -> Array:
    """Places (k, 3) m of the umbrellas of people of stature (k,) m, from their limbs: position (k, limbs, 3) m and quaternion (k, limbs, 4) wxyz."""
    if not len(stature):
        return np.zeros((0, 3))
    along = Rotation.from_quat(quaternion[:, _FORE], scalar_first=True).as_matrix()[:, :, 2]
    size = trunk_size(stature)
    return np.asarray(position[:, _FORE] - along * ((FOREARM + HAND_CENTRE) * size)[:, None])
