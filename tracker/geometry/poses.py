"""Rigid motions, angles and unit directions.

Conventions: right-handed frames, metres, radians, angles anticlockwise about +z in (−π, π]. `T_a_b` maps points in b to
points in a; a tangent vector is [translation, rotation] and T ⊕ ξ = T · Exp(ξ). Rows are points: (n, 3).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from tracker.geometry.arrays import Array, frozen


def wrap(angle: ArrayLike) -> Any:
    """Angles in radians of any shape, wrapped to (−π, π]."""
    wrapped = np.pi - np.mod(np.pi - np.asarray(angle, dtype=np.float64), 2 * np.pi)
    # Just above π the remainder rounds up to 2π.
    return wrapped + 2 * np.pi * (wrapped <= -np.pi)


def skew(vector: ArrayLike) -> Array:
    """(3,) → (3, 3) with skew(a) @ b = a × b; (n, 3) → (n, 3, 3)."""
    v = np.asarray(vector, dtype=np.float64)
    out = np.zeros((*v.shape, 3))
    out[..., 0, 1], out[..., 0, 2], out[..., 1, 2] = -v[..., 2], v[..., 1], -v[..., 0]
    out[..., 1, 0], out[..., 2, 0], out[..., 2, 1] = v[..., 2], -v[..., 1], v[..., 0]
    return out


def exp_so3(phi: ArrayLike) -> Array:
    """Rotation vector (3,) in radians → rotation (3, 3), by Rodrigues' formula with its series near zero."""
    v = np.asarray(phi, dtype=np.float64)
    angle2 = float(v @ v)
    K = skew(v)
    if angle2 < 1e-10:
        return np.eye(3) + (1 - angle2 / 6) * K + (0.5 - angle2 / 24) * (K @ K)
    angle = np.sqrt(angle2)
    return np.eye(3) + np.sin(angle) / angle * K + (1 - np.cos(angle)) / angle2 * (K @ K)


def log_so3(rotation: ArrayLike) -> Array:
    """Rotation (3, 3) → rotation vector (3,), angle in [0, π]. The quaternion between them is well conditioned at 0 and near π."""
    w, x, y, z = quaternion_from_rotation(rotation)
    vector = np.array([x, y, z])
    norm = float(np.linalg.norm(vector))
    if norm < 1e-8:
        return 2 * vector / w
    return vector * (2 * np.arctan2(norm, w) / norm)


def quaternion_from_rotation(rotation: ArrayLike) -> Array:
    """Rotation (3, 3) → unit quaternion (4,) wxyz with w ≥ 0 (Shepperd 1978: divide by the largest component)."""
    R = np.asarray(rotation, dtype=np.float64)
    squares = np.array([1 + np.trace(R), 1 + 2 * R[0, 0] - np.trace(R), 1 + 2 * R[1, 1] - np.trace(R), 1 + 2 * R[2, 2] - np.trace(R)])
    columns = np.array(
        [
            [squares[0], R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]],
            [R[2, 1] - R[1, 2], squares[1], R[0, 1] + R[1, 0], R[0, 2] + R[2, 0]],
            [R[0, 2] - R[2, 0], R[0, 1] + R[1, 0], squares[2], R[1, 2] + R[2, 1]],
            [R[1, 0] - R[0, 1], R[0, 2] + R[2, 0], R[1, 2] + R[2, 1], squares[3]],
        ]
    )
    q = columns[int(np.argmax(squares))]
    q = q / np.linalg.norm(q)
    return -q if q[0] < 0 else q


def rotation_from_quaternion(quaternion: ArrayLike) -> Array:
    """Quaternion (4,) wxyz, of any length but zero → rotation (3, 3). Raises ValueError for another shape and for a zero quaternion."""
    q = np.asarray(quaternion, dtype=np.float64)
    if q.shape != (4,):
        raise ValueError(f"quaternion has {q.size} numbers, needs 4")
    norm = np.linalg.norm(q)
    if not norm > 0:
        raise ValueError(f"quaternion has length {norm}, needs more than 0")
    w, v = q[0] / norm, q[1:] / norm
    return np.eye(3) + 2 * w * skew(v) + 2 * skew(v) @ skew(v)


def rotation_z(yaw: float) -> Array:
    """Rotation (3, 3) by `yaw` radians about +z."""
    c, s = np.cos(yaw), np.sin(yaw)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


@dataclass(frozen=True, eq=False)
class Pose:
    """A rigid motion T_a_b: rotation (3, 3), translation (3,) m. Raises ValueError where the rotation is not orthonormal to 1e-6."""

    rotation: Array
    translation: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "rotation", frozen(self.rotation, (3, 3), "rotation"))
        object.__setattr__(self, "translation", frozen(self.translation, (3,), "translation"))
        error = float(np.abs(self.rotation @ self.rotation.T - np.eye(3)).max())
        if not error < 1e-6 or np.linalg.det(self.rotation) < 0:
            raise ValueError(f"rotation differs from a rotation by {error:.2g}, needs less than 1e-6 and determinant +1")

    @staticmethod
    def identity() -> Pose:
        return Pose(np.eye(3), np.zeros(3))

    @staticmethod
    def planar(x: float, y: float, yaw: float, z: float = 0.0) -> Pose:
        """The pose at (x, y, z) m turned by `yaw` radians about +z."""
        return Pose(rotation_z(yaw), np.array([x, y, z]))

    @staticmethod
    def exp(xi: ArrayLike) -> Pose:
        """Tangent (6,) [translation, rotation] → Pose: the translation is taken as it is, the rotation by exp_so3.

        This is the exponential of R³ × SO(3), not of SE(3): the position's error stays in metres along the axes of the body.
        """
        v = np.asarray(xi, dtype=np.float64)
        return Pose(exp_so3(v[3:]), v[:3])

    def log(self) -> Array:
        """The tangent (6,) [translation, rotation] with exp(log(T)) = T."""
        return np.concatenate([self.translation, log_so3(self.rotation)])

    def __matmul__(self, other: Pose) -> Pose:
        R = self.rotation @ other.rotation
        # One Newton step of orthogonalisation: thousands of products would drift otherwise.
        R = 1.5 * R - 0.5 * R @ R.T @ R
        return Pose(R, self.rotation @ other.translation + self.translation)

    def inverse(self) -> Pose:
        return Pose(self.rotation.T, -self.rotation.T @ self.translation)

    def apply(self, points: ArrayLike) -> Array:
        """Points (n, 3) or (3,) in b → the same shape in a."""
        return np.asarray(points, dtype=np.float64) @ self.rotation.T + self.translation

    @property
    def yaw(self) -> float:
        """Heading of the x axis in the plane, radians in (−π, π]."""
        return float(np.arctan2(self.rotation[1, 0], self.rotation[0, 0]))


def bearing_from_angles(azimuth: ArrayLike, elevation: ArrayLike) -> Array:
    """Azimuth and elevation, radians, any shape → unit directions (..., 3), x forward, y left, z up."""
    az, el = np.asarray(azimuth, dtype=np.float64), np.asarray(elevation, dtype=np.float64)
    return np.stack([np.cos(el) * np.cos(az), np.cos(el) * np.sin(az), np.sin(el)], axis=-1)


def angles_from_bearing(bearing: ArrayLike) -> tuple[Array, Array]:
    """Directions (..., 3) of any length → azimuth in (−π, π] and elevation in [−π/2, π/2], radians."""
    b = np.asarray(bearing, dtype=np.float64)
    return np.arctan2(b[..., 1], b[..., 0]), np.arctan2(b[..., 2], np.hypot(b[..., 0], b[..., 1]))


def tangent_basis(bearing: ArrayLike) -> Array:
    """Unit directions (..., 3) → two orthonormal rows (..., 2, 3) across them: towards growing azimuth, towards growing elevation.

    At the poles, where no azimuth exists, the first row is +y.
    """
    b = np.asarray(bearing, dtype=np.float64)
    horizontal = np.hypot(b[..., 0], b[..., 1])
    pole = horizontal < 1e-12
    safe = np.where(pole, 1.0, horizontal)
    c, s = np.where(pole, 1.0, b[..., 0] / safe), np.where(pole, 0.0, b[..., 1] / safe)
    out = np.empty((*b.shape[:-1], 2, 3))
    out[..., 0, 0], out[..., 0, 1], out[..., 0, 2] = -s, c, 0.0
    # The second row is the cross product of b and the first, written out: np.cross takes three times as long.
    out[..., 1, 0], out[..., 1, 1], out[..., 1, 2] = -b[..., 2] * c, -b[..., 2] * s, b[..., 0] * c + b[..., 1] * s
    return out


def perturbed_bearings(bearing: Array, error: Array) -> Array:
    """Unit directions (n, 3) moved by error (n, 2) rad along the rows of their tangent bases → (n, 3) unit."""
    out = bearing + np.einsum("nk,nki->ni", error, tangent_basis(bearing))
    out /= np.linalg.norm(out, axis=1, keepdims=True)
    return np.asarray(out)


def rotation_onto(points: Array, onto: Array, upright: bool = False) -> Array:
    """The rotation (d, d) of the rigid motion that aligns `points` (n, d) m with `onto` (n, d) m in the least-squares sense.

    d is 2 or 3 (Umeyama 1991, eqs. 39 to 42, with scale 1). upright: only rotations about z are considered; for d = 3.
    """
    M = (onto - onto.mean(axis=0)).T @ (points - points.mean(axis=0))
    if upright:
        return rotation_z(float(np.arctan2(M[1, 0] - M[0, 1], M[0, 0] + M[1, 1])))
    U, _, Vt = np.linalg.svd(M)
    signs = np.ones(len(M))
    signs[-1] = np.linalg.det(U) * np.linalg.det(Vt)
    return np.asarray(U @ np.diag(signs) @ Vt)
