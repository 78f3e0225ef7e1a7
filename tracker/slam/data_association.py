"""Which sighting shows which landmark: by how it looks, and by where the joint state expects it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tracker.ekf.gaussian import gate
from tracker.ekf.measurement_models import CameraPose, jacobians, predict
from tracker.ekf.state import JointState
from tracker.geometry import Array, Floats, Indices, Mask, tangent_basis


@dataclass(frozen=True)
class Gate:
    """probability: of a right sighting to pass; window: rad about the prediction within which a look-alike that fails counts as refused;
    unlike: largest distance of unit descriptors, stranger: the same for a landmark that this robot has not seen yet (from another side half of the
    matches beyond 0.4 are wrong); ratio: the best over the second best in the window; nearest m: closer landmarks are left alone.
    """

    probability: float = 0.999
    window: float = 0.15
    unlike: float = 0.6
    stranger: float = 0.4
    ratio: float = 0.85
    nearest: float = 0.3


@dataclass(frozen=True, eq=False)
class Matches:
    """landmark (k,) and sighting (k,), pairs, each number once. refused (r,) and refused_sighting (r,): pairs that look alike and lie near but
    outside the gate. expected (n,): landmarks that are not too near to be seen.
    """

    landmark: Indices
    sighting: Indices
    refused: Indices
    refused_sighting: Indices
    expected: Mask


def innovation_covariance(joint: JointState, robot: int, sight: CameraPose, landmarks: Indices) -> Array:
    """H P Hᵀ of the bearing of each of some landmarks (n,) alone, (n, 2, 2) rad²."""
    n = len(landmarks)
    rotation, translation, point = joint.anchors
    anchored = replace(sight, body_rotation=rotation[robot], body_translation=translation[robot])
    H_body, H_point, H_correction = jacobians(anchored, point[landmarks])
    H_robot = np.concatenate([H_body, H_correction], axis=2) if joint.corrected else H_body
    at, base = joint.offset(robot), joint.base
    seen = H_robot.shape[2]
    own = slice(at, at + seen)
    index = base + 3 * landmarks[:, None] + np.arange(3)
    cross = joint.P[own][:, index.ravel()].reshape(seen, n, 3).transpose(1, 0, 2)
    points = joint.P[index[:, :, None], index[:, None, :]]
    mixed = H_robot @ cross @ H_point.transpose(0, 2, 1)
    S = H_robot @ joint.P[own, own] @ H_robot.transpose(0, 2, 1) + mixed + mixed.transpose(0, 2, 1)
    return S + H_point @ points @ H_point.transpose(0, 2, 1)


def associate(joint: JointState, robot: int, sight: CameraPose, seen: tuple[Array, Array], looks: tuple[Floats, Mask], rule: Gate) -> Matches:
    """One camera's sightings, seen = bearings (m, 3) and covariances (m, 2, 2), against the map; looks = how unlike (n, m) landmarks and sightings
    are (landmarks.dissimilarity), and which landmarks (n,) the robot has seen before.

    A pair stands where each is the other's best look among those inside the Mahalanobis gate, and the landmark has no second sighting in the wide
    window that looks nearly as much like it. The ratio is asked in that direction only: the map may hold a place twice.
    """
    bearing, covariance = seen
    unlike, known = looks
    n, m = joint.count, len(bearing)
    none = np.zeros(0, dtype=np.intp)
    if n == 0 or m == 0:
        return Matches(none, none, none, none, np.zeros(n, dtype=bool))
    predicted, distance = predict(sight, joint.point[:n])
    expected = distance > rule.nearest
    near = predicted @ bearing.T > np.cos(rule.window)
    alike = near & (unlike < np.where(known, rule.unlike, rule.stranger)[:, None]) & expected[:, None]
    # Most landmarks look like nothing that is near them: the rest is asked of the others alone.
    some = np.flatnonzero(alike.any(axis=1))
    if len(some) == 0:
        return Matches(none, none, none, none, expected)
    near, alike, unlike = near[some], alike[some], unlike[some]
    row, column = np.nonzero(alike)
    S = innovation_covariance(joint, robot, sight, some)[row] + covariance[column]
    e = (tangent_basis(predicted[some])[row] @ bearing[column][:, :, None])[..., 0]
    inside = np.zeros_like(alike)
    inside[row, column] = _distances2(e, S) < gate(2, rule.probability)
    landmark, sighting = mutual(np.where(inside, unlike, np.inf), np.where(near, unlike, np.inf), rule.ratio)
    free = alike & ~inside
    free[landmark] = False
    free[:, sighting] = False
    refused, refused_sighting = mutual(np.where(free, unlike, np.inf), np.where(near, unlike, np.inf), rule.ratio)
    return Matches(some[landmark], sighting, some[refused], refused_sighting, expected)


def _distances2(e: Array, S: Array) -> Array:
    """e (k, 2), S (k, 2, 2) → squared Mahalanobis distances (k,), by the closed inverse of 2 × 2."""
    x, y = e.T
    a, b, c = S[:, 0, 0], S[:, 0, 1], S[:, 1, 1]
    d2: Array = (c * x * x - 2 * b * x * y + a * y * y) / (a * c - b * b)
    return d2


def mutual(cost: NDArray[np.floating], rivals: NDArray[np.floating], ratio: float) -> tuple[Indices, Indices]:
    """Pairs (row, column) of `cost` (n, m) that are each other's least, finite, and less than `ratio` times the row's next best in `rivals`."""
    best = cost.argmin(axis=1)
    rows = np.arange(len(cost))
    value = cost[rows, best]
    others = rivals.copy()
    others[rows, best] = np.inf
    # A rival that looks better than the best of those inside spoils the match as well: value < ratio · next fails.
    distinct = np.isfinite(value) & (value <= ratio * others.min(axis=1, initial=np.inf))
    mutual = cost.argmin(axis=0)[best] == rows
    kept = np.flatnonzero(distinct & mutual)
    return kept, best[kept]
