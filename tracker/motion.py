"""How robots move, and how an error state of poses is moved along: prediction by odometry, the retraction and its Jacobian.

A pose's error is its right tangent [translation, rotation]: T = T̂ · Exp(ξ), Exp that of R³ × SO(3) (geometry.Pose.exp).
"""

from __future__ import annotations

import numpy as np

from tracker.geometry import Array, exp_so3, right_jacobian_so3, skew
from tracker.measurements import Odometry


def compose(rotation: Array, translation: Array, odometry: Odometry) -> tuple[Array, Array, Array]:
    """T · T_before_now: rotation (3, 3), translation (3,) of the new pose, and the Jacobian F (6, 6) of its error in the error before.

    The covariance after it is F P Fᵀ + Q with Q the odometry's own, which is in the right tangent of the motion and so of the new pose.
    With o, O the translation and rotation of the motion: ρ' = Oᵀ(ρ − [o]× φ) + η_ρ, φ' = Oᵀ φ + η_φ (from (R Exp φ) (o + O η) to first order).
    """
    O, o = odometry.T_before_now.rotation, odometry.T_before_now.translation
    F = np.zeros((6, 6))
    F[:3, :3] = F[3:, 3:] = O.T
    F[:3, 3:] = -O.T @ skew(o)
    R = rotation @ O
    return 1.5 * R - 0.5 * R @ R.T @ R, translation + rotation @ o, F


def retract(rotation: Array, translation: Array, xi: Array) -> tuple[Array, Array]:
    """T · Exp(ξ) for ξ (6,): rotation (3, 3), translation (3,)."""
    R = rotation @ exp_so3(xi[3:])
    return 1.5 * R - 0.5 * R @ R.T @ R, translation + rotation @ xi[:3]


def retraction_jacobian(xi: Array) -> Array:
    """J (6, 6) with (T · Exp(ξ)) · Exp(J δ) ≈ T · Exp(ξ + δ): carries a tangent at T to the tangent at T · Exp(ξ).

    An iterated filter linearises at T · Exp(ξ) while its covariance lives at T: H J is the Jacobian there, and J P Jᵀ the covariance after
    the mean has moved (the "reset" of an error-state filter; Solà 2017, 6.3). The rotation's block is the right Jacobian of SO(3).
    """
    J = np.zeros((6, 6))
    J[:3, :3] = exp_so3(xi[3:]).T
    J[3:, 3:] = right_jacobian_so3(xi[3:])
    return J
