"""Measurement models of unit directions: of a landmark, or of another robot, by a camera on a robot, and of "up" by an accelerometer; and the
inverse model.

A residual lives in the tangent plane of the predicted direction (geometry.tangent_basis): two numbers, no seam at ±π, no pole. Its Jacobians
are those of the prediction: residual ≈ H δ + noise where δ is what the state lacks.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from tracker.geometry import Array, exp_so3, skew, tangent_basis


@dataclass(frozen=True, eq=False)
class CameraPose:
    """Where a camera is: the body's rotation (3, 3) and translation (3,) m in the world, the mount's in the body, and the correction factor.

    correction (3,) rad is a rotation vector w of the camera in the body, about the mount's place: R_world_camera = R_world_body Exp(w) R_body_camera.
    The body may come in rows, (n, 3, 3) and (n, 3): one pose a landmark.
    """

    body_rotation: Array
    body_translation: Array
    mount_rotation: Array
    mount_translation: Array
    correction: Array

    @cached_property
    def bent(self) -> Array:
        """Exp(w) of the correction, (3, 3)."""
        return exp_so3(self.correction)

    @cached_property
    def turn(self) -> Array:
        """R_body_camera with the correction, (3, 3)."""
        return self.bent @ self.mount_rotation

    @cached_property
    def rotation(self) -> Array:
        """R_world_camera, (3, 3) or (n, 3, 3)."""
        return self.body_rotation @ self.turn

    @cached_property
    def origin(self) -> Array:
        """The camera in the world, (3,) or (n, 3) m."""
        return self.body_translation + self.body_rotation @ self.mount_translation

    def points(self, landmarks: Array) -> Array:
        """Landmarks (n, 3) m in the world → (n, 3) m in the camera's frame."""
        return _rows(landmarks - self.origin, self.rotation)


def _rows(vectors: Array, rotation: Array) -> Array:
    """Row vectors (n, 3) times a matrix (3, 3) or one each (n, 3, 3)."""
    return (vectors[..., None, :] @ rotation)[..., 0, :]


def residual(measured: Array, predicted: Array) -> Array:
    """Unit directions (..., 3) measured and predicted → (..., 2) rad: the turn that leads from the predicted to the measured one.

    The logarithm of the sphere at the predicted direction in its tangent basis; its length is the angle, up to π.
    """
    e = np.einsum("...ij,...j->...i", tangent_basis(predicted), measured)
    sine = np.linalg.norm(e, axis=-1)
    angle = np.arctan2(sine, (measured * predicted).sum(axis=-1))
    return e * np.where(sine > 1e-9, angle / np.maximum(sine, 1e-9), 1.0)[..., None]


def predict(sight: CameraPose, landmarks: Array) -> tuple[Array, Array]:
    """Landmarks (n, 3) m → unit bearings (n, 3) in the camera's frame and ranges (n,) m (never under 1 µm)."""
    p = sight.points(landmarks)
    distance = np.maximum(np.linalg.norm(p, axis=1), 1e-6)
    return p / distance[:, None], distance


def jacobians(sight: CameraPose, landmarks: Array) -> tuple[Array, Array, Array]:
    """Of the bearings of landmarks (n, 3) in the tangent plane of the prediction, per n: (n, 2, 6) in the body's right tangent,
    (n, 2, 3) in the landmark, (n, 2, 3) in the right tangent of the correction Exp(w) · Exp(δ).

    With q the landmark in the body and p = Mᵀ(q − m) in the camera: dq = −ρ + [q]× φ + Rᵀ dl, dp = Mᵀ dq, and dp = Rmᵀ [u]× δ
    with u = Exp(w)ᵀ (q − m); the direction takes B / |p| of it.
    """
    bearing, distance = predict(sight, landmarks)
    B = tangent_basis(bearing) / distance[:, None, None]
    across = B @ sight.turn.T
    q = _rows(landmarks - sight.body_translation, sight.body_rotation)
    u = (q - sight.mount_translation) @ sight.bent
    body = np.concatenate([-across, across @ skew(q)], axis=2)
    return body, across @ np.swapaxes(sight.body_rotation, -1, -2), B @ sight.mount_rotation.T @ skew(u)


def robot_jacobians(sight: CameraPose, others: tuple[Array, Array], levers: Array) -> tuple[Array, Array, Array]:
    """Of the bearings of places at levers m (n, 3) in the bodies of other robots, with rotations R (n, 3, 3) and translations (n, 3) m: (n, 2, 6) in
    the right tangent of the body that sees, (n, 2, 3) in that of its correction, (n, 2, 6) in those of the others, dl = R ρ − R [m]× φ.
    """
    rotation, translation = others
    body, place, correction = jacobians(sight, translation + (rotation @ levers[..., None])[..., 0])
    across = place @ rotation
    return body, correction, np.concatenate([across, -across @ skew(levers)], axis=2)


def gravity(rotation: Array, up: Array) -> tuple[Array, Array]:
    """The body's rotation (3, 3) and the measured unit "up" (3,) in its frame → residual (2,) rad and Jacobian (2, 6) in the body's tangent."""
    predicted = rotation[2]
    H = np.zeros((2, 6))
    H[:, 3:] = tangent_basis(predicted) @ skew(predicted)
    return residual(up, predicted), H


@dataclass(frozen=True, eq=False)
class TriangulatedPoint:
    """A landmark found from k bearings: point (3,) m; how it moves with the poses, G_body (3, k, 6), and with the correction, G_correction (3, 3);
    own (3, 3) m²: what the noise of the bearings adds. misfit (2k − 3,): what is left of the bearings once the point is taken out, with
    unit noise, and its Jacobians (2k − 3, k, 6) and (2k − 3, 3) in the same poses and correction.
    """

    point: Array
    G_body: Array
    G_correction: Array
    own: Array
    misfit: Array
    misfit_body: Array
    misfit_correction: Array


def intersect(origins: Array, directions: Array) -> tuple[Array, NDArray[np.bool_]]:
    """The point nearest to k lines, for n bundles at once: origins, directions (n, k, 3) → points (n, 3) and whether each is in front of all.

    Nearest in the mean of squares of distances. Bundles of parallel lines give a point that is in front of none.
    """
    across = np.eye(3) - directions[..., :, None] * directions[..., None, :]
    A = across.sum(axis=1)
    sound = np.linalg.det(A) > 1e-9
    A[~sound] = np.eye(3)
    point = np.linalg.solve(A, np.einsum("nkij,nkj->ni", across, origins)[..., None])[..., 0]
    depth = ((point[:, None] - origins) * directions).sum(axis=2)
    return point, sound & (depth > 0).all(axis=1)


def triangulate(sights: CameraPose, bearings: Array, covariances: Array, start: Array, anchors: CameraPose | None = None) -> TriangulatedPoint:
    """The inverse measurement model: the point that k bearings (k, 3) with covariances (k, 2, 2) rad² mean, from a `start` (3,) m near it.

    The sights come in k rows. Two steps of Gauss-Newton on the sum of squares Σ |z − h|²; the Jacobians come from its stationarity: with
    H_l = Q [C; 0] of the whitened rows the first three rows of Qᵀ fix the point and the others are free of it (the null-space projection of
    Mourikis & Roumeliotis 2007). anchors: where Jacobians are taken, if not where the sights are.
    """
    point, k = start, len(bearings)
    white = np.linalg.inv(np.linalg.cholesky(covariances))
    for _ in range(2):
        points = np.tile(point, (k, 1))
        body, place, correction = (white @ H for H in jacobians(sights, points))
        r = (white @ residual(bearings, predict(sights, points)[0])[..., None]).reshape(-1)
        Q, C = np.linalg.qr(place.reshape(-1, 3), mode="complete")
        inverse = np.linalg.inv(C[:3])
        point = point + inverse @ (Q[:, :3].T @ r)
    if anchors is not None:
        body, place, correction = (white @ H for H in jacobians(anchors, np.tile(point, (k, 1))))
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
        own=inverse @ inverse.T,
        misfit=rest @ r,
        misfit_body=(rest @ H_body).reshape(-1, k, 6),
        misfit_correction=rest @ H_w,
    )
