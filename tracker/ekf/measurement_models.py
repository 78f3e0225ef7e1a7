"""Measurement models of unit directions with their Jacobians, and triangulation, which is the inverse model.

The directions are those of a landmark or another robot, seen by a camera on a robot, and of "up" by an accelerometer. A residual lies in the
tangent plane of the predicted direction (geometry.tangent_basis): two numbers, without a singularity at ±π or at a pole. Its
Jacobians are those of the prediction: residual ≈ H δ + noise, with δ the error of the state.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from tracker.geometry import Array, exp_so3, skew, tangent_basis


@dataclass(frozen=True, eq=False)
class CameraPose:
    """The pose of a camera: the body in the world, the mount in the body, and the correction factor.

    body_rotation (3, 3), body_translation (3,) m, mount_rotation (3, 3), mount_translation (3,) m. correction (3,) rad is a rotation
    vector w of the camera about the mount's origin: R_world_camera = R_world_body Exp(w) R_body_camera. The body may come in rows,
    (n, 3, 3) and (n, 3): one pose per landmark.
    """

    body_rotation: Array
    body_translation: Array
    mount_rotation: Array
    mount_translation: Array
    correction: Array

    @cached_property
    def correction_rotation(self) -> Array:
        """Exp(w) of the correction, (3, 3)."""
        return exp_so3(self.correction)

    @cached_property
    def R_body_camera(self) -> Array:
        """The mount's rotation with the correction, (3, 3)."""
        return self.correction_rotation @ self.mount_rotation

    @cached_property
    def rotation(self) -> Array:
        """R_world_camera, (3, 3) or (n, 3, 3)."""
        return self.body_rotation @ self.R_body_camera

    @cached_property
    def origin(self) -> Array:
        """The camera's position in the world, (3,) or (n, 3) m."""
        return self.body_translation + self.body_rotation @ self.mount_translation

    def points(self, landmarks: Array) -> Array:
        """Landmarks (n, 3) m in the world → (n, 3) m in the camera's frame."""
        return _rows(landmarks - self.origin, self.rotation)


def _rows(vectors: Array, rotation: Array) -> Array:
    """Row vectors (n, 3) times one matrix (3, 3), or one matrix each (n, 3, 3)."""
    return (vectors[..., None, :] @ rotation)[..., 0, :]


def residual(measured: Array, predicted: Array) -> Array:
    """Measured and predicted unit directions (..., 3) → (..., 2) rad: the rotation from the predicted to the measured one.

    It is the logarithm on the sphere at the predicted direction, in its tangent basis; its length is the angle, up to π.
    """
    e = np.einsum("...ij,...j->...i", tangent_basis(predicted), measured)
    sine = np.linalg.norm(e, axis=-1)
    angle = np.arctan2(sine, (measured * predicted).sum(axis=-1))
    return e * np.where(sine > 1e-9, angle / np.maximum(sine, 1e-9), 1.0)[..., None]


def predict(camera: CameraPose, landmarks: Array) -> tuple[Array, Array]:
    """Landmarks (n, 3) m → unit bearings (n, 3) in the camera's frame and ranges (n,) m, at least 1 µm."""
    p = camera.points(landmarks)
    distance = np.maximum(np.linalg.norm(p, axis=1), 1e-6)
    return p / distance[:, None], distance


def jacobians(camera: CameraPose, landmarks: Array) -> tuple[Array, Array, Array]:
    """Jacobians of the bearings of landmarks (n, 3) in the tangent plane of the prediction.

    Returns (n, 2, 6) in the body's right tangent, (n, 2, 3) in the landmark, and (n, 2, 3) in the right tangent of the correction
    Exp(w) · Exp(δ). With q the landmark in the body and p = Mᵀ(q − m) in the camera: dq = −ρ + [q]× φ + Rᵀ dl and dp = Mᵀ dq.
    For the correction dp = Rmᵀ [u]× δ with u = Exp(w)ᵀ (q − m). The direction's part of dp is B dp / |p|.
    """
    bearing, distance = predict(camera, landmarks)
    B = tangent_basis(bearing) / distance[:, None, None]
    across = B @ camera.R_body_camera.T
    q = _rows(landmarks - camera.body_translation, camera.body_rotation)
    u = (q - camera.mount_translation) @ camera.correction_rotation
    body = np.concatenate([-across, across @ skew(q)], axis=2)
    return body, across @ np.swapaxes(camera.body_rotation, -1, -2), B @ camera.mount_rotation.T @ skew(u)


def robot_jacobians(camera: CameraPose, others: tuple[Array, Array], levers: Array) -> tuple[Array, Array, Array]:
    """Jacobians of the bearings of points with levers (n, 3) m in the bodies of other robots.

    others: rotations R (n, 3, 3) and translations (n, 3) m of these bodies. Returns (n, 2, 6) in the right tangent of the observing body,
    (n, 2, 3) in its correction, and (n, 2, 6) in the tangents of the other bodies, where dl = R ρ − R [m]× φ.
    """
    rotation, translation = others
    body, place, correction = jacobians(camera, translation + (rotation @ levers[..., None])[..., 0])
    across = place @ rotation
    return body, correction, np.concatenate([across, -across @ skew(levers)], axis=2)


def gravity(rotation: Array, up: Array) -> tuple[Array, Array]:
    """The measured "up": the body's rotation (3, 3) and the unit vector up (3,) in its frame → residual (2,) rad and Jacobian (2, 6)."""
    predicted = rotation[2]
    H = np.zeros((2, 6))
    H[:, 3:] = tangent_basis(predicted) @ skew(predicted)
    return residual(up, predicted), H


@dataclass(frozen=True, eq=False)
class TriangulatedPoint:
    """A landmark triangulated from k bearings, with its dependence on the poses and the correction.

    point (3,) m; G_body (3, k, 6) and G_correction (3, 3): its Jacobians in the poses and the correction. noise_covariance (3, 3) m²: the part
    of the bearings' noise. misfit (2k − 3,): residuals of the bearings after the point is eliminated, with unit noise. misfit_body (2k − 3, k, 6)
    and misfit_correction (2k − 3, 3): their Jacobians in the same poses and correction.
    """

    point: Array
    G_body: Array
    G_correction: Array
    noise_covariance: Array
    misfit: Array
    misfit_body: Array
    misfit_correction: Array


def intersect(origins: Array, directions: Array) -> tuple[Array, NDArray[np.bool_]]:
    """The points nearest to k lines each, for n bundles: origins, directions (n, k, 3) → points (n, 3) and whether each lies ahead of all cameras.

    Nearest in the sum of squared distances. Bundles of parallel lines give a point that is ahead of none.
    """
    across = np.eye(3) - directions[..., :, None] * directions[..., None, :]
    A = across.sum(axis=1)
    well_conditioned = np.linalg.det(A) > 1e-9
    A[~well_conditioned] = np.eye(3)
    point = np.linalg.solve(A, np.einsum("nkij,nkj->ni", across, origins)[..., None])[..., 0]
    depth = ((point[:, None] - origins) * directions).sum(axis=2)
    return point, well_conditioned & (depth > 0).all(axis=1)


def triangulate(
    cameras: CameraPose, bearings: Array, covariances: Array, start: Array, linearization_points: CameraPose | None = None
) -> TriangulatedPoint:
    """The point that k bearings (k, 3) with covariances (k, 2, 2) rad² determine, from an initial point `start` (3,) m.

    The camera poses come in k rows. Two Gauss-Newton steps minimise Σ |z − h|², and the Jacobians follow from its stationarity. With the whitened
    rows H_l = Q [C; 0] the first three rows of Qᵀ determine the point. The others do not depend on it: the null-space projection of
    Mourikis & Roumeliotis 2007. linearization_points: camera poses at which Jacobians are taken, if they differ.
    """
    point, k = start, len(bearings)
    white = np.linalg.inv(np.linalg.cholesky(covariances))
    for _ in range(2):
        points = np.tile(point, (k, 1))
        body, place, correction = (white @ H for H in jacobians(cameras, points))
        r = (white @ residual(bearings, predict(cameras, points)[0])[..., None]).reshape(-1)
        Q, C = np.linalg.qr(place.reshape(-1, 3), mode="complete")
        inverse = np.linalg.inv(C[:3])
        point = point + inverse @ (Q[:, :3].T @ r)
    if linearization_points is not None:
        body, place, correction = (white @ H for H in jacobians(linearization_points, np.tile(point, (k, 1))))
        Q, C = np.linalg.qr(place.reshape(-1, 3), mode="complete")
        inverse = np.linalg.inv(C[:3])
    spread = np.zeros((k, 2, k, 6))
    spread[np.arange(k), :, np.arange(k)] = body
    H_body, H_w = spread.reshape(-1, 6 * k), correction.reshape(-1, 3)
    gain, rest = inverse @ Q[:, :3].T, Q[:, 3:].T
    return TriangulatedPoint(
        point=point,
        G_body=(-gain @ H_body).reshape(3, k, 6),
        G_correction=-gain @ H_w,
        noise_covariance=inverse @ inverse.T,
        misfit=rest @ r,
        misfit_body=(rest @ H_body).reshape(-1, k, 6),
        misfit_correction=rest @ H_w,
    )
