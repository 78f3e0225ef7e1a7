"""The right-invariant error of poses and landmarks, written in the tangents that the joint state keeps (Barrau & Bonnabel 2015; Zhang et al. 2017).

In the invariant error a turn φ of the world takes every place p along by φ × p. Kept in plain tangents at the present mean, that error is the same as
any other until the mean moves: then what was φ × p before must be φ × p after, so the error of a place that has moved by Δ gains φ × Δ. These are
the linear maps that do so; with them, a turn of the whole world about any axis and its translation stay directions of which sightings tell nothing.
"""

from __future__ import annotations

import numpy as np

from tracker.ekf.lie_kernels import orthogonal, right_jacobian
from tracker.geometry import Array, skew

Means = tuple[Array, Array, Array]
"""Rotations (p, 3, 3), translations (p, 3) m and landmarks (n, 3) m."""


def pose_charts(before: Means, after: Means) -> Array:
    """(p, 6, 6): from right tangents [m, rad] of poses before to those after; each pose goes with its own rotation."""
    turn = np.swapaxes(after[0], 1, 2)
    out = np.zeros((len(turn), 6, 6))
    out[:, :3, :3] = out[:, 3:, 3:] = turn @ before[0]
    out[:, :3, 3:] = -turn @ skew(after[1] - before[1]) @ before[0]
    return out


def landmark_shears(before: Means, after: Means, robot: int) -> Array:
    """(n, 3, 3): what the errors of landmarks gain from the rotation error before, rad in its right tangent, of the robot that they are tied to."""
    return -skew(after[2] - before[2]) @ before[0][robot]


def retracted(before: Means, change: tuple[Array, Array], exponentials: Array, robot: int) -> Means:
    """Means ⊞ change = tangents (p, 6) and moves (n, 3) m, exponentials (p, 3, 3) of the tangents' rotations: each place moves by V(φ) times its own
    part, V the left Jacobian of SO(3), φ the rotation of its pose, or that of the robot for landmarks: the exponential of the invariant error.
    """
    tangents, moves = change
    V = right_jacobian(-tangents[:, 3:])
    rotation = orthogonal(before[0] @ exponentials)
    translation = before[1] + (before[0] @ V @ tangents[:, :3, None])[..., 0]
    carry = before[0][robot] @ V[robot] @ before[0][robot].T
    return rotation, translation, before[2] + moves @ carry.T
