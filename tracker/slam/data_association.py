"""Data association of sightings and landmarks: by descriptors, and by a Mahalanobis gate about the predicted bearing; and of detected robots.

The bearing of another robot's camera correlates two poses of the joint state, and corrects both (Roumeliotis & Bekey 2002). It needs no
common landmarks. Sightings that lie on a robot are no landmarks.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tracker.ekf.gaussian import gate, mahalanobis2
from tracker.ekf.linearization import RobotMeasurements, linearize
from tracker.ekf.measurement_models import CameraPose, jacobians, predict
from tracker.ekf.state import JointState
from tracker.geometry import Array, Floats, Indices, Mask, tangent_basis
from tracker.types import Mount, RobotDetections, Setup, Sightings


@dataclass(frozen=True)
class Gate:
    """Parameters of data association.

    probability: of a correct sighting to pass the gate. window: rad about the prediction; a similar pair within it that fails the gate counts
    as rejected. max_distance: of unit descriptors. max_distance_new_view: the same for a landmark that this robot has not seen yet. Half of
    the matches from another side with a distance above 0.4 are wrong. ratio: of the best distance to the second best in the window.
    min_range m: nearer landmarks are not matched.
    """

    probability: float = 0.999
    window: float = 0.15
    max_distance: float = 0.6
    max_distance_new_view: float = 0.4
    ratio: float = 0.85
    min_range: float = 0.3


@dataclass(frozen=True, eq=False)
class Matches:
    """Pairs of landmarks and sightings.

    landmark (k,), sighting (k,): matched pairs, each number once. rejected (r,), rejected_sighting (r,): pairs of similar descriptors in the window
    but outside the gate. in_range (n,): landmarks beyond the minimum range.
    """

    landmark: Indices
    sighting: Indices
    rejected: Indices
    rejected_sighting: Indices
    in_range: Mask


def innovation_covariance(joint: JointState, robot: int, camera: CameraPose, landmarks: Indices) -> Array:
    """H P Hᵀ of the bearing of each of the given landmarks (n,), (n, 2, 2) rad²."""
    n = len(landmarks)
    rotation, translation, point = joint.linearization_points
    for_jacobians = replace(camera, body_rotation=rotation[robot], body_translation=translation[robot])
    H_body, H_point, H_correction = jacobians(for_jacobians, point[landmarks])
    H_robot = np.concatenate([H_body, H_correction], axis=2) if joint.has_correction else H_body
    at, base = joint.offset(robot), joint.base
    seen = H_robot.shape[2]
    own = slice(at, at + seen)
    index = base + 3 * landmarks[:, None] + np.arange(3)
    cross = joint.P[own][:, index.ravel()].reshape(seen, n, 3).transpose(1, 0, 2)
    points = joint.P[index[:, :, None], index[:, None, :]]
    mixed = H_robot @ cross @ H_point.transpose(0, 2, 1)
    S = H_robot @ joint.P[own, own] @ H_robot.transpose(0, 2, 1) + mixed + mixed.transpose(0, 2, 1)
    return S + H_point @ points @ H_point.transpose(0, 2, 1)


def associate(
    joint: JointState, robot: int, camera: CameraPose, seen: tuple[Array, Array], appearance: tuple[Floats, Mask], parameters: Gate
) -> Matches:
    """Match the sightings of one camera with the map.

    seen: bearings (m, 3) and covariances (m, 2, 2) rad². appearance: descriptor distances (n, m) of landmarks and sightings
    (landmark_map.dissimilarity), and which landmarks (n,) the robot has seen before.

    In a matched pair each is the other's nearest descriptor among the pairs inside the Mahalanobis gate. The ratio test is over the landmark's
    sightings in the window. It is not made in the other direction, because the map may hold a place twice.
    """
    bearing, covariance = seen
    descriptor_distance, seen_before = appearance
    n, m = joint.count, len(bearing)
    none = np.zeros(0, dtype=np.intp)
    if n == 0 or m == 0:
        return Matches(none, none, none, none, np.zeros(n, dtype=bool))
    predicted, distance = predict(camera, joint.point[:n])
    in_range = distance > parameters.min_range
    near = predicted @ bearing.T > np.cos(parameters.window)
    similar = (
        near & (descriptor_distance < np.where(seen_before, parameters.max_distance, parameters.max_distance_new_view)[:, None]) & in_range[:, None]
    )
    # Most landmarks have no similar sighting near them: the gate is computed for the others alone.
    candidates = np.flatnonzero(similar.any(axis=1))
    if len(candidates) == 0:
        return Matches(none, none, none, none, in_range)
    near, similar, descriptor_distance = near[candidates], similar[candidates], descriptor_distance[candidates]
    row, column = np.nonzero(similar)
    S = innovation_covariance(joint, robot, camera, candidates)[row] + covariance[column]
    e = (tangent_basis(predicted[candidates])[row] @ bearing[column][:, :, None])[..., 0]
    inside = np.zeros_like(similar)
    inside[row, column] = _distances2(e, S) < gate(2, parameters.probability)
    landmark, sighting = mutual_nearest(np.where(inside, descriptor_distance, np.inf), np.where(near, descriptor_distance, np.inf), parameters.ratio)
    free = similar & ~inside
    free[landmark] = False
    free[:, sighting] = False
    rejected, rejected_sighting = mutual_nearest(
        np.where(free, descriptor_distance, np.inf), np.where(near, descriptor_distance, np.inf), parameters.ratio
    )
    return Matches(candidates[landmark], sighting, candidates[rejected], rejected_sighting, in_range)


def _distances2(e: Array, S: Array) -> Array:
    """e (k, 2), S (k, 2, 2) → squared Mahalanobis distances (k,), by the closed inverse of a 2 × 2 matrix."""
    x, y = e.T
    a, b, c = S[:, 0, 0], S[:, 0, 1], S[:, 1, 1]
    d2: Array = (c * x * x - 2 * b * x * y + a * y * y) / (a * c - b * b)
    return d2


def mutual_nearest(cost: NDArray[np.floating], rivals: NDArray[np.floating], ratio: float) -> tuple[Indices, Indices]:
    """Pairs (row, column) of `cost` (n, m) that are each other's minimum, finite, and at most `ratio` times the row's next in `rivals` (n, m)."""
    best = cost.argmin(axis=1)
    rows = np.arange(len(cost))
    value = cost[rows, best]
    others = rivals.copy()
    others[rows, best] = np.inf
    # A rival outside the gate that is more similar than the best inside it also fails this test.
    distinct = np.isfinite(value) & (value <= ratio * others.min(axis=1, initial=np.inf))
    is_mutual = cost.argmin(axis=0)[best] == rows
    kept = np.flatnonzero(distinct & is_mutual)
    return kept, best[kept]


def identify(setup: Setup, mount: Mount, seen: RobotDetections, team: Mapping[str, int]) -> RobotMeasurements:
    """The detections of robots of the `team` (robot → number in the joint state), sorted by number."""
    rows = [(team[name], i) for i, name in enumerate(seen.robot) if name in team]
    other, row = np.array(sorted(rows), dtype=np.intp).reshape(-1, 2).T
    levers = np.array([setup.mount_of(seen.robot[i]).T_body_camera.translation for i in row]).reshape(-1, 3)
    return RobotMeasurements(mount, other, levers, seen.bearing[row], seen.covariance[row])


def within_gate(joint: JointState, robot: int, seen: RobotMeasurements, probability: float) -> Mask:
    """(j,) whether each bearing alone lies within the gate that a correct one passes with `probability`."""
    linear, j = linearize(joint, robot, None, None, seen), np.arange(len(seen))
    spread = linear.H @ joint.P[np.ix_(linear.columns, linear.columns)] @ linear.H.T
    S = spread.reshape(len(j), 2, len(j), 2)[j, :, j] + linear.noise
    inside: Mask = mahalanobis2(linear.residual.reshape(-1, 2), S) < gate(2, probability)
    return inside


def on_robots(joint: JointState, camera: CameraPose, others: Iterable[int], seen: Sightings, radius: float) -> Mask:
    """(n,) whether a sighting without a name lies within `radius` m of the centre of one of the other robots."""
    moving = np.zeros(len(seen), dtype=bool)
    for other in others:
        p = camera.points(joint.translation[other][None])[0]
        distance = np.linalg.norm(p)
        reach = np.arctan2(radius, max(float(distance), 1e-6))
        moving |= (seen.bearing @ p > distance * np.cos(reach)) & (seen.subject < 0)
    return moving
