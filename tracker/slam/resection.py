"""Resection of a levelled panorama: yaw and position from directions to landmarks, robust to wrong matches.

Gravity gives the vertical, so that four unknowns are left. The azimuths of three landmarks give yaw and position in the plane by a linear
system. Each horizontal direction, rotated by the yaw, is parallel to the vector to the landmark. Their elevations give the height. All triplets
of the most similar pairs are tried, as RANSAC does at random, and the best consensus is refined by least squares.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from tracker.geometry import Array, Indices, rotation_z, tangent_basis


@dataclass(frozen=True)
class RelocalizationParameters:
    """Parameters of resection and relocalization.

    max_distance, ratio: of descriptors, as in data_association.Gate. max_pairs: the most similar pairs that are used; triplet_pairs: those of
    which all triplets are tried. tolerance rad: error of a correct pair beside the landmark's own. min_inliers: random pairs have 3
    to 5; min_inliers_unknown_start: the same for a robot that has not been in the team; min_inlier_share: of all. max_sigma m, rad: largest
    standard deviations.

    A robot may be lost if it matches less than match_share of its usual number. It is lost with at most max_matches_lost matches, for up to
    timeout s. pose_sigma m, rad: standard deviations of the found pose before an update by its inliers. archive_pose_sigma m, rad: the same
    where these are not in the map. archive_size: landmarks.
    """

    max_distance: float = 0.5
    ratio: float = 0.9
    max_pairs: int = 60
    triplet_pairs: int = 20
    tolerance: float = 0.02
    min_inliers: int = 7
    min_inliers_unknown_start: int = 10
    min_inlier_share: float = 0.2
    max_sigma: tuple[float, float] = (0.3, 0.1)
    match_share: float = 0.4
    max_matches_lost: int = 3
    timeout: float = 5.0
    pose_sigma: tuple[float, float] = (0.5, 0.1)
    archive_pose_sigma: tuple[float, float] = (0.1, 0.03)
    archive_size: int = 2000

    def __post_init__(self) -> None:
        if self.min_inliers < 4:
            raise ValueError(f"min_inliers is {self.min_inliers}, needs at least 4: any three agree")


@dataclass(frozen=True, eq=False)
class Resection:
    """The result: origin (3,) m of the camera and yaw rad of the levelled directions in the landmarks' frame.

    covariance (4, 4) of both [m, m, m, rad]; inliers (n,): the consistent pairs.
    """

    origin: Array
    yaw: float
    covariance: Array
    inliers: Indices


def resect(direction: Array, point: Array, sigma: Array, parameters: RelocalizationParameters) -> Resection | str:
    """The camera's pose from unit directions (k, 3) in a levelled frame and landmarks at points (k, 3) m, or the reason of failure.

    sigma (k,) m: standard deviations of the landmarks. The most similar pair comes first.
    """
    direction, point, sigma = direction[: parameters.max_pairs], point[: parameters.max_pairs], sigma[: parameters.max_pairs]
    if len(direction) < parameters.min_inliers:
        return "too little alike"
    best = _consensus(direction, point, sigma, parameters)
    if best is None:
        return "places disagree"
    origin, yaw = best
    for _ in range(5):
        inliers = np.flatnonzero(_normalized_errors(origin[None], np.array([yaw]), (direction, point, sigma), parameters)[0] < 1)
        if len(inliers) < max(parameters.min_inliers, parameters.min_inlier_share * len(direction)):
            return "places disagree"
        step, C = _gauss_newton_step(origin, yaw, (direction[inliers], point[inliers], sigma[inliers]), parameters)
        origin, yaw = origin + step[:3], yaw + float(step[3])
    if not (np.sqrt(np.diag(C)) < np.repeat(parameters.max_sigma, (3, 1))).all():
        return "place not sharp"
    return Resection(origin, yaw, C, inliers)


def _consensus(direction: Array, point: Array, sigma: Array, parameters: RelocalizationParameters) -> tuple[Array, float] | None:
    """Position and yaw of the best of all triplets; None if none has its landmarks ahead."""
    triplets = np.array(list(combinations(range(min(parameters.triplet_pairs, len(point))), 3)))
    middle = point.mean(axis=0)
    origin, yaw = _from_triplets(direction[triplets], (point - middle)[triplets])
    if len(origin) == 0:
        return None
    best = int(np.minimum(_normalized_errors(origin + middle, yaw, (direction, point, sigma), parameters), 1).sum(axis=1).argmin())
    return origin[best] + middle, float(yaw[best])


def _from_triplets(direction: Array, point: Array) -> tuple[Array, Array]:
    """Directions and points (h, 3, 3) of h triplets → origins (n, 3) and yaws (n,) of those with all three landmarks ahead."""
    flat = np.maximum(np.hypot(direction[..., 0], direction[..., 1]), 1e-9)
    c, s, slope = direction[..., 0] / flat, direction[..., 1] / flat, direction[..., 2] / flat
    x, y = point[..., 0], point[..., 1]
    # With (a, b) = (cos, sin) of the yaw and (u, v) = (a X + b Y, b X − a Y) of the place (X, Y): M (a, b, u, v) = 0.
    M = np.stack([s * x - c * y, c * x + s * y, -s, -c], axis=-1)
    null = np.stack([(-1) ** j * np.linalg.det(np.delete(M, j, axis=2)) for j in range(4)])
    size = np.hypot(null[0], null[1])
    a, b, u, v = null / np.maximum(size, 1e-12)
    offset = np.stack([x - (a * u + b * v)[:, None], y - (b * u - a * v)[:, None]], axis=-1)
    # The null vector of the opposite sign has the opposite yaw.
    along = offset[..., 0] * (a[:, None] * c - b[:, None] * s) + offset[..., 1] * (b[:, None] * c + a[:, None] * s)
    valid = (size > 1e-9) & ((along > 0).all(axis=1) | (along < 0).all(axis=1))
    height = (point[..., 2] - slope * np.linalg.norm(offset, axis=2)).mean(axis=1)
    yaw = np.arctan2(b, a) + np.pi * (along[:, 0] < 0)
    return np.stack([a * u + b * v, b * u - a * v, height], axis=1)[valid], yaw[valid]


def _normalized_errors(origin: Array, yaw: Array, pairs: tuple[Array, Array, Array], parameters: RelocalizationParameters) -> Array:
    """(h, k): squared angles between directions and landmarks for h poses, over the square of three of their standard deviations."""
    direction, point, sigma = pairs
    offset = point - origin[:, None]
    distance = np.maximum(np.linalg.norm(offset, axis=2), 1e-6)
    c, s = np.cos(yaw)[:, None], np.sin(yaw)[:, None]
    x, y = c * direction[:, 0] - s * direction[:, 1], s * direction[:, 0] + c * direction[:, 1]
    cosine = (offset[..., 0] * x + offset[..., 1] * y + offset[..., 2] * direction[:, 2]) / distance
    out: Array = (2 - 2 * cosine) / (9 * (parameters.tolerance**2 + (sigma / distance) ** 2))
    return out


def _gauss_newton_step(origin: Array, yaw: float, pairs: tuple[Array, Array, Array], parameters: RelocalizationParameters) -> tuple[Array, Array]:
    """One Gauss-Newton step (4,) for position and yaw, and the covariance (4, 4)."""
    direction, point, sigma = pairs
    R = rotation_z(yaw)
    q = (point - origin) @ R
    distance = np.linalg.norm(q, axis=1)
    B = tangent_basis(q / distance[:, None])
    r = (B @ direction[:, :, None])[..., 0]
    # q = Rᵀ (p − c): the error of yaw, a rotation about z, moves it by −z × q.
    moved = np.stack([q[:, 1], -q[:, 0], np.zeros(len(q))], axis=1)
    J = B / distance[:, None, None] @ np.concatenate([np.tile(-R.T, (len(q), 1, 1)), moved[:, :, None]], axis=2)
    weight = 1 / (parameters.tolerance**2 + (sigma / distance) ** 2)
    C: Array = np.linalg.inv(np.einsum("nki,n,nkj->ij", J, weight, J))
    return C @ np.einsum("nki,n,nk->i", J, weight, r), C
