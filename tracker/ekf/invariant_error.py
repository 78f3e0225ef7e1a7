"""The right-invariant error of poses and landmarks, expressed in the tangents of the joint state (Barrau & Bonnabel 2015; Zhang et al. 2017).

In the invariant error a rotation error φ of the world displaces every point p by φ × p. In plain tangents at the present mean the
error is the same until the mean moves. If a point's mean moves by Δ, its error gains φ × Δ. The functions here are these linear maps.
With them a rotation of the whole world about any axis, and its translation, stay unobservable directions of the filter.
"""

from __future__ import annotations

import numpy as np

from tracker.ekf.lie_kernels import orthogonal, right_jacobian
from tracker.geometry import Array, skew

Means = tuple[Array, Array, Array]
"""Rotations (p, 3, 3), translations (p, 3) m and landmarks (n, 3) m."""


def pose_error_maps(before: Means, after: Means) -> Array:
    """(p, 6, 6): maps from right tangents [m, rad] of the poses before to those of the poses after; each pose uses its own rotation."""
    turn = np.swapaxes(after[0], 1, 2)
    out = np.zeros((len(turn), 6, 6))
    out[:, :3, :3] = out[:, 3:, 3:] = turn @ before[0]
    out[:, :3, 3:] = -turn @ skew(after[1] - before[1]) @ before[0]
    return out


def landmark_error_couplings(before: Means, after: Means, robot: int) -> Array:
    """(n, 3, 3): what landmark errors gain from the rotation error (rad, in the right tangent before) of the robot that they are tied to."""
    return -skew(after[2] - before[2]) @ before[0][robot]


def retract_invariant(before: Means, change: tuple[Array, Array], exponentials: Array, robot: int) -> Means:
    """Means ⊞ change by the exponential of the invariant error.

    change: tangents (p, 6) [m, rad] and moves (n, 3) m of landmarks. exponentials (p, 3, 3): those of the tangents' rotations. Each point moves
    by V(φ) times its own part, with V the left Jacobian of SO(3). φ is the rotation of its pose, and for landmarks that of `robot`.
    """
    tangents, moves = change
    V = right_jacobian(-tangents[:, 3:])
    rotation = orthogonal(before[0] @ exponentials)
    translation = before[1] + (before[0] @ V @ tangents[:, :3, None])[..., 0]
    carry = before[0][robot] @ V[robot] @ before[0][robot].T
    return rotation, translation, before[2] + moves @ carry.T
