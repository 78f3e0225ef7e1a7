"""SE(3) operations on many poses at once: composition with odometry, exponential, logarithm, retraction, and their Jacobians.

A pose's error is its right tangent [translation, rotation]: T = T̂ · Exp(ξ), with Exp that of R³ × SO(3) (geometry.Pose.exp). Poses come in
rows: rotation (n, 3, 3) and translation (n, 3) m.
"""

from __future__ import annotations

import numpy as np

from tracker.geometry import Array, Pose, skew


def compose(rotation: Array, translation: Array, motion: Pose) -> tuple[Array, Array, Array]:
    """T · motion of one pose, motion = T_before_now: rotation (3, 3), translation (3,) m, and the Jacobian F (6, 6) in the error before.

    The covariance after it is F P Fᵀ + Q. Q is the odometry's covariance in the right tangent of the motion, hence of the new pose.
    With o and M the translation and rotation of the motion: ρ' = Mᵀ(ρ − [o]× φ) + η_ρ, φ' = Mᵀ φ + η_φ (first order of R Exp φ (o + M η)).
    """
    M, o = motion.rotation, motion.translation
    F = np.zeros((6, 6))
    F[:3, :3] = F[3:, 3:] = M.T
    F[:3, 3:] = -M.T @ skew(o)
    return orthogonal(rotation @ M), translation + rotation @ o, F


def orthogonal(rotation: Array) -> Array:
    """Rotations (..., 3, 3) up to rounding → one Newton step towards orthogonal matrices."""
    return 1.5 * rotation - 0.5 * rotation @ np.swapaxes(rotation, -1, -2) @ rotation


def exponential(phi: Array) -> Array:
    """Rotation vectors (n, 3) rad → rotations (n, 3, 3) by Rodrigues' formula, accurate near zero, as geometry.exp_so3."""
    angle2 = (phi * phi).sum(axis=-1)[..., None, None]
    K, angle = skew(phi), np.sqrt(angle2)
    # sinc(x) = sin(πx)/(πx) is accurate at zero, and (1 − cos a)/a² is half the square of sinc at half the angle.
    return np.eye(3) + np.sinc(angle / np.pi) * K + 0.5 * np.sinc(angle / (2 * np.pi)) ** 2 * (K @ K)


def logarithm(rotation: Array) -> Array:
    """Rotations (n, 3, 3) by angles well below π → rotation vectors (n, 3) rad; geometry.log_so3 is accurate near π, too."""
    odd = rotation - np.swapaxes(rotation, 1, 2)
    sine = 0.5 * np.stack([odd[:, 2, 1], odd[:, 0, 2], odd[:, 1, 0]], axis=1)
    size = np.linalg.norm(sine, axis=1)
    angle = np.arctan2(size, 0.5 * (np.trace(rotation, axis1=1, axis2=2) - 1))
    return sine * np.where(size > 1e-9, angle / np.maximum(size, 1e-9), 1.0)[:, None]


def right_jacobian(phi: Array) -> Array:
    """J (n, 3, 3) with Exp(φ + δ) ≈ Exp(φ) Exp(J δ) for rows φ (n, 3) rad (Solà, Deray, Atchuthan 2018, eq. 143)."""
    angle2 = (phi * phi).sum(axis=-1)[..., None, None]
    K, angle = skew(phi), np.sqrt(angle2)
    small = angle2 < 1e-4
    safe = np.where(small, 1.0, angle2)
    cubic = np.where(small, 1 / 6 - angle2 / 120, (1 - np.sinc(angle / np.pi)) / safe)
    return np.eye(3) - 0.5 * np.sinc(angle / (2 * np.pi)) ** 2 * K + cubic * (K @ K)


def retract(rotation: Array, translation: Array, xi: Array) -> tuple[Array, Array]:
    """T · Exp(ξ) for rows ξ (n, 6): rotation (n, 3, 3), translation (n, 3)."""
    return orthogonal(rotation @ exponential(xi[:, 3:])), translation + (rotation @ xi[:, :3, None])[..., 0]


def retraction_jacobian(xi: Array) -> Array:
    """J (n, 6, 6) with (T · Exp(ξ)) · Exp(J δ) ≈ T · Exp(ξ + δ): maps a tangent at T to the tangent at T · Exp(ξ).

    An iterated filter linearises at T · Exp(ξ) while its covariance is defined at T. H J is the Jacobian there. J P Jᵀ is the covariance after
    the mean has moved: the reset of an error-state filter (Solà 2017, 6.3). The block of the rotation is the right Jacobian of SO(3).
    """
    J = np.zeros((len(xi), 6, 6))
    J[:, :3, :3] = np.swapaxes(exponential(xi[:, 3:]), 1, 2)
    J[:, 3:, 3:] = right_jacobian(xi[:, 3:])
    return J
