"""Tracks of people on the ground: constant velocity, seen as directions by any number of views, and how tall each is.

All live tracks are held in arrays, one row a track, so that a crowd costs a few numpy calls. `predict`, `sights` and `update`
return new values; nothing is changed in place.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from tracker.detections.cross_view import CrossViewGroup
from tracker.detections.ground_points import GroundDetections
from tracker.geometry import Array, Ints, Mask, tangent_basis
from tracker.geometry.ground import Ground


@dataclass(frozen=True)
class MotionParameters:
    """How people move."""

    acceleration: float = 0.8  # m/s², spectral: variance of the velocity grows by its square a second
    start_speed: float = 1.0  # m/s, standard deviation of an unknown velocity, an axis
    foot_spread: float = 0.25  # m, the feet stray this far from the ground under the body
    v_max: float = 3.0  # m/s, nobody goes faster: what does was made of other people's boxes, or of nobody's
    posture: float = 0.005  # m/√s, how people stoop and stretch
    early: float = 0.4  # s out of sight, from which on ...
    onward: float = 1.0  # ... people forget within so many s where they were going: many are out of sight because they stopped or turned


@dataclass(frozen=True, eq=False)
class Tracks:
    """Rows are tracks. tree (n,): the id, never used again; state (n, 5) x, y m, velocity m/s and stature m; covariance (n, 5, 5);
    score (n,): log-likelihood ratio against clutter; hits, misses, age (n,): frames seen in all, unseen in a row, since birth.
    """

    tree: Ints
    state: Array
    covariance: Array
    score: Array
    hits: Ints
    misses: Ints
    age: Ints

    @staticmethod
    def none() -> Tracks:
        zero = np.zeros(0, dtype=np.int64)
        return Tracks(zero, np.zeros((0, 5)), np.zeros((0, 5, 5)), np.zeros(0), zero, zero, zero)

    def __len__(self) -> int:
        return len(self.tree)

    @property
    def speed(self) -> Array:
        """(n,) m/s."""
        return np.asarray(np.linalg.norm(self.state[:, 2:4], axis=1))

    @property
    def doubt(self) -> Array:
        """(n,) m, standard deviation of the place, the greater of two."""
        a, b, c = (self.covariance[:, i, j] for i, j in ((0, 0), (0, 1), (1, 1)))
        return np.asarray(np.sqrt((a + c) / 2 + np.hypot((a - c) / 2, b)))

    def select(self, rows: Mask | Ints) -> Tracks:
        return Tracks(*(getattr(self, name)[rows] for name in _COLUMNS))

    def join(self, other: Tracks) -> Tracks:
        return Tracks(*(np.concatenate([getattr(self, name), getattr(other, name)]) for name in _COLUMNS))


_COLUMNS = tuple(Tracks.__dataclass_fields__)

_SEEN = [0, 1, 4]
"""Columns of a state of which boxes tell: place and stature."""


def transition(dt: float, motion: MotionParameters) -> tuple[Array, Array]:
    """F and Q (4, 4) of `dt` seconds with white acceleration (Bar-Shalom, Li, Kirubarajan 2001, eq. 6.2.2-12)."""
    F = np.eye(4)
    F[0, 2] = F[1, 3] = dt
    return F, np.kron(np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]]), np.eye(2)) * motion.acceleration**2


def onward(misses: Ints, dt: float, motion: MotionParameters) -> tuple[Array, Array]:
    """F (n, 5, 5) of tracks that were not seen for so many ticks (n,) in a row, and Q (5, 5): as `transition`, but that the velocity of those who are
    out of sight fades, as the mean of an Ornstein-Uhlenbeck process does. Statures stay, but for how people hold themselves.
    """
    F, Q = np.eye(5), np.zeros((5, 5))
    F[:4, :4], Q[:4, :4] = transition(dt, motion)
    Q[4, 4] = motion.posture**2 * dt
    fade = np.exp(-dt / motion.onward)
    fading = np.diag([1.0, 1.0, fade, fade, 1.0])
    fading[0, 2] = fading[1, 3] = halting(dt, motion)
    return np.where((misses * dt > motion.early)[:, None, None], fading, F), Q


def halting(gap: float, motion: MotionParameters) -> float:
    """s for which people would have to go on as they went to come as far as they do in `gap` s, while they forget where they were going."""
    return motion.onward * (1 - float(np.exp(-gap / motion.onward)))


def predict(tracks: Tracks, dt: float, motion: MotionParameters) -> Tracks:
    """All tracks `dt` seconds on."""
    F, Q = onward(tracks.misses, dt, motion)
    state = (F @ tracks.state[:, :, None])[:, :, 0]
    return replace(tracks, state=state, covariance=F @ tracks.covariance @ F.transpose(0, 2, 1) + Q, age=tracks.age + 1)


def initiated(first_tree: int, groups: list[CrossViewGroup], motion: MotionParameters, stature: tuple[float, float]) -> Tracks:
    """One new track a combination, at rest with an unknown velocity, and as tall as people are; stature: their mean and standard deviation, m."""
    n = len(groups)
    state, covariance = np.zeros((n, 5)), np.zeros((n, 5, 5))
    for k, group in enumerate(groups):
        state[k, :2] = group.point
        covariance[k, :2, :2] = group.covariance
    state[:, 4], covariance[:, 4, 4] = stature[0], stature[1] ** 2
    covariance[:, 2, 2] = covariance[:, 3, 3] = motion.start_speed**2
    ones = np.ones(n, dtype=np.int64)
    return Tracks(first_tree + np.arange(n), state, covariance, np.zeros(n), ones, 0 * ones, ones)


@dataclass(frozen=True, eq=False)
class Sights:
    """Every track as one view expects it, against every box of that view.

    residual (t, d, 2) rad: box minus expected foot direction, along azimuth and along elevation; H (t, 2, 2): its derivative by x, y;
    expected (t, 2, 2): covariance of the expected direction; height (t, d) m: the box's upper edge over the ground where the track stands;
    climb (t, d, 2): its derivative by x, y; distance (t,) m; drop (t,) m: how far the feet are below the view.
    """

    residual: Array
    H: Array
    expected: Array
    height: Array
    climb: Array
    distance: Array
    drop: Array


def sights(tracks: Tracks, feet: GroundDetections, offset: Array, ground: Ground, motion: MotionParameters) -> Sights:
    """Compare all tracks with all boxes of a view; offset (t, 2) m on the ground is the view's own error there."""
    place = tracks.state[:, :2]
    z = ground.height_at(place)
    # Places are not known to a step of the ground: slopes over less than people stray say more than they know.
    around = [np.array([0.3, 0.0]), np.array([0.0, 0.3])]
    rise = [(ground.height_at(place + e) - ground.height_at(place - e)) / 0.6 for e in around]
    sight = np.column_stack([place, z]) - feet.origin
    distance = np.maximum(np.linalg.norm(sight, axis=1), 0.2)
    expected = sight / distance[:, None]
    basis = tangent_basis(expected)
    G = np.zeros((len(tracks), 3, 2))
    G[:, 0, 0] = G[:, 1, 1] = 1.0
    G[:, 2, 0], G[:, 2, 1] = rise
    H = basis @ G / distance[:, None, None]
    residual = np.einsum("tij,dj->tdi", basis, feet.direction) - (H @ offset[:, :, None])[:, None, :, 0]
    behind = expected @ feet.direction.T < 0.5
    residual[behind] = np.inf
    spread = tracks.covariance[:, :2, :2] + motion.foot_spread**2 * np.eye(2)
    over = np.hypot(sight[:, 0], sight[:, 1])
    steep = np.tan(feet.head_elevation)
    height = feet.origin[2] - z[:, None] + over[:, None] * steep[None, :]
    toward = sight[:, :2] / np.maximum(over, 1e-9)[:, None]
    climb = toward[:, None, :] * steep[None, :, None] - np.stack(rise, axis=1)[:, None, :]
    return Sights(residual, H, H @ spread @ H.transpose(0, 2, 1), height, climb, distance, feet.origin[2] - z)


class Heads(NamedTuple):
    """The upper edges of a view's boxes as measurements of place and stature together. above (t, d) m: how much taller a box is than the track where
    the track stands; H (t, d, 3): derivative of that by x, y and stature; noise (t, d) m²: variance of the edge; spread (t, d) m²: of `above`."""

    above: Array
    H: Array
    noise: Array
    spread: Array

    def fit(self, gate: float) -> Mask:
        """Which (t, d) are within `gate` standard deviations."""
        return np.asarray(self.above**2 < gate**2 * self.spread)


def heads(tracks: Tracks, look: Sights, feet: GroundDetections, nod: float) -> Heads:
    """nod m: how far the top of a head strays from the stature over the ground."""
    H = np.concatenate([-look.climb, np.ones((*look.height.shape, 1))], axis=2)
    noise = feet.covariance[:, 1, 1] * look.distance[:, None] ** 2 + nod**2
    spread = np.einsum("tdi,tij,tdj->td", H, tracks.covariance[:, _SEEN][:, :, _SEEN], H) + noise
    return Heads(look.height - tracks.state[:, 4:], H, noise, spread)


def update(tracks: Tracks, row: int, residual: Array, H: Array, R: Array) -> Tracks:
    """Correct one track: residual (m,), H (m, 2) by x, y or (m, 3) by stature, too, R (m, m); Kalman's update in Joseph form."""
    P, full = tracks.covariance[row], np.zeros((len(residual), 5))
    full[:, _SEEN[: H.shape[1]]] = H
    K = np.linalg.solve(full @ P @ full.T + R, full @ P).T
    A = np.eye(5) - K @ full
    state, covariance = tracks.state.copy(), tracks.covariance.copy()
    state[row] += K @ residual
    covariance[row] = A @ P @ A.T + K @ R @ K.T
    return replace(tracks, state=state, covariance=covariance)


def informed(tracks: Tracks, rows: Ints, A: Array, before: tuple[Array, Array], after: tuple[Array, Array]) -> Tracks:
    """The tracks where mean (r, k) and covariance (r, k, k) of A (r, k, 5) times the states of `rows` (r,) are known to be other than before.

    All else follows as far as it is known to go with that.
    """
    P = tracks.covariance[rows]
    G = np.linalg.solve(before[1], A @ P).transpose(0, 2, 1)
    state, covariance = tracks.state.copy(), tracks.covariance.copy()
    state[rows] += (G @ (after[0] - before[0])[:, :, None])[:, :, 0]
    covariance[rows] = P + G @ (after[1] - before[1]) @ G.transpose(0, 2, 1)
    return replace(tracks, state=state, covariance=covariance)
