"""Where a levelled panorama was taken, from how things look alone: yaw and place from directions to landmarks, with wrong pairs among them.

Gravity tells which way is up, so that four numbers are left. The azimuths of three landmarks give yaw and place in the plane by a linear system
(for each, the horizontal direction turned by the yaw is parallel to the way to the landmark), their elevations the height; all threes of the pairs
that look most alike are tried, and what most pairs agree with is made better by least squares.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from tracker.geometry import Array, Indices, rotation_z, tangent_basis


@dataclass(frozen=True)
class Search:
    """unlike, ratio: how much alike a pair must look, as in association.Gate; limit: pairs that are used, the most alike first; threes: of so many of
    them all threes are tried; tolerance rad: by which a right pair may be off, beside the landmark's own error; pairs: at least so many must agree
    (of pairs at random 3 to 5 do), strangers: the same for a robot that has never been one of the team, and the share of all; sharp m, rad: largest
    standard deviations.

    drop: a robot that matches less than this share of the landmarks that it used to match may have lost its way; few: with at most so many it has,
    and is looked for; patience s: for so long; doubt m, rad: standard deviations of its pose where it is found, before the landmarks that it sees
    there are taken in; firm m, rad: the same where these are in the map no more; memory: so many of such landmarks are remembered.
    """

    unlike: float = 0.5
    ratio: float = 0.9
    limit: int = 60
    threes: int = 20
    tolerance: float = 0.02
    pairs: int = 7
    strangers: int = 10
    share: float = 0.2
    sharp: tuple[float, float] = (0.3, 0.1)
    drop: float = 0.4
    few: int = 3
    patience: float = 5.0
    doubt: tuple[float, float] = (0.5, 0.1)
    firm: tuple[float, float] = (0.1, 0.03)
    memory: int = 2000

    def __post_init__(self) -> None:
        if self.pairs < 4:
            raise ValueError(f"pairs is {self.pairs}, needs at least 4: any three agree")


@dataclass(frozen=True, eq=False)
class Resection:
    """origin (3,) m of the camera and yaw rad of the levelled directions in the frame of the landmarks; covariance (4, 4) of both [m, m, m, rad];
    agreed (n,): the pairs that agree.
    """

    origin: Array
    yaw: float
    covariance: Array
    agreed: Indices


def resect(direction: Array, place: Array, spread: Array, rule: Search) -> Resection | str:
    """Unit directions (k, 3) from the camera, level but for an unknown yaw, to landmarks at places (k, 3) m with standard deviations spread (k,) m,
    the most alike pair first. What is wrong where they do not fit.
    """
    direction, place, spread = direction[: rule.limit], place[: rule.limit], spread[: rule.limit]
    if len(direction) < rule.pairs:
        return "too little alike"
    best = _consensus(direction, place, spread, rule)
    if best is None:
        return "places disagree"
    origin, yaw = best
    for _ in range(5):
        agreed = np.flatnonzero(_odds(origin[None], np.array([yaw]), (direction, place, spread), rule)[0] < 1)
        if len(agreed) < max(rule.pairs, rule.share * len(direction)):
            return "places disagree"
        step, C = _newton(origin, yaw, (direction[agreed], place[agreed], spread[agreed]), rule)
        origin, yaw = origin + step[:3], yaw + float(step[3])
    if not (np.sqrt(np.diag(C)) < np.repeat(rule.sharp, (3, 1))).all():
        return "place not sharp"
    return Resection(origin, yaw, C, agreed)


def _consensus(direction: Array, place: Array, spread: Array, rule: Search) -> tuple[Array, float] | None:
    """Place and yaw of the best of all threes; None where none puts its landmarks ahead."""
    three = np.array(list(combinations(range(min(rule.threes, len(place))), 3)))
    middle = place.mean(axis=0)
    origin, yaw = _of_threes(direction[three], (place - middle)[three])
    if len(origin) == 0:
        return None
    best = int(np.minimum(_odds(origin + middle, yaw, (direction, place, spread), rule), 1).sum(axis=1).argmin())
    return origin[best] + middle, float(yaw[best])


def _of_threes(direction: Array, place: Array) -> tuple[Array, Array]:
    """Directions and places (h, 3, 3) of h threes → origins (n, 3) and yaws (n,) of those that have one with all three ahead."""
    flat = np.maximum(np.hypot(direction[..., 0], direction[..., 1]), 1e-9)
    c, s, slope = direction[..., 0] / flat, direction[..., 1] / flat, direction[..., 2] / flat
    x, y = place[..., 0], place[..., 1]
    # With (a, b) = (cos, sin) of the yaw and (u, v) = (a X + b Y, b X − a Y) of the place (X, Y): M (a, b, u, v) = 0.
    M = np.stack([s * x - c * y, c * x + s * y, -s, -c], axis=-1)
    null = np.stack([(-1) ** j * np.linalg.det(np.delete(M, j, axis=2)) for j in range(4)])
    size = np.hypot(null[0], null[1])
    a, b, u, v = null / np.maximum(size, 1e-12)
    way = np.stack([x - (a * u + b * v)[:, None], y - (b * u - a * v)[:, None]], axis=-1)
    # The other sign of the null vector is the yaw that looks the other way.
    along = way[..., 0] * (a[:, None] * c - b[:, None] * s) + way[..., 1] * (b[:, None] * c + a[:, None] * s)
    sound = (size > 1e-9) & ((along > 0).all(axis=1) | (along < 0).all(axis=1))
    height = (place[..., 2] - slope * np.linalg.norm(way, axis=2)).mean(axis=1)
    yaw = np.arctan2(b, a) + np.pi * (along[:, 0] < 0)
    return np.stack([a * u + b * v, b * u - a * v, height], axis=1)[sound], yaw[sound]


def _odds(origin: Array, yaw: Array, pairs: tuple[Array, Array, Array], rule: Search) -> Array:
    """(h, k): squared angles between directions and landmarks as seen from h places, over the square of three of their standard deviations."""
    direction, place, spread = pairs
    way = place - origin[:, None]
    distance = np.maximum(np.linalg.norm(way, axis=2), 1e-6)
    c, s = np.cos(yaw)[:, None], np.sin(yaw)[:, None]
    x, y = c * direction[:, 0] - s * direction[:, 1], s * direction[:, 0] + c * direction[:, 1]
    cosine = (way[..., 0] * x + way[..., 1] * y + way[..., 2] * direction[:, 2]) / distance
    out: Array = (2 - 2 * cosine) / (9 * (rule.tolerance**2 + (spread / distance) ** 2))
    return out


def _newton(origin: Array, yaw: float, pairs: tuple[Array, Array, Array], rule: Search) -> tuple[Array, Array]:
    """One step of Gauss and Newton (4,) for place and yaw, and the covariance (4, 4)."""
    direction, place, spread = pairs
    R = rotation_z(yaw)
    q = (place - origin) @ R
    distance = np.linalg.norm(q, axis=1)
    B = tangent_basis(q / distance[:, None])
    r = (B @ direction[:, :, None])[..., 0]
    # q = Rᵀ (p − c): a turn about z by the yaw's error moves it by −z × q.
    moved = np.stack([q[:, 1], -q[:, 0], np.zeros(len(q))], axis=1)
    J = B / distance[:, None, None] @ np.concatenate([np.tile(-R.T, (len(q), 1, 1)), moved[:, :, None]], axis=2)
    weight = 1 / (rule.tolerance**2 + (spread / distance) ** 2)
    C: Array = np.linalg.inv(np.einsum("nki,n,nkj->ij", J, weight, J))
    return C @ np.einsum("nki,n,nk->i", J, weight, r), C
