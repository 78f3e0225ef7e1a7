"""Tracks of people on the ground: state, motion model, innovations against the boxes of a view, and the Kalman update.

The state holds place, velocity and stature. All tracks are rows of arrays, so that a crowd costs a few numpy calls. `predict`, `innovations` and
`update` return new values; nothing is changed in place.
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
    """Motion of people."""

    acceleration: float = 0.8  # m/s², square root of the growth of the velocity's variance a second
    start_speed: float = 1.0  # m/s, standard deviation of an unknown velocity, an axis
    foot_spread: float = 0.25  # m, standard deviation of the feet from the ground under the body
    v_max: float = 3.0  # m/s, a faster track is deleted: it consists of false boxes or of several people's
    stature_drift: float = 0.005  # m/√s, random walk of the apparent stature
    fade_after: float = 0.4  # s without a box after which the velocity of a coasting track decays
    fade_time: float = 1.0  # s, time constant of that decay: people are often hidden because they stop or turn


@dataclass(frozen=True, eq=False)
class Tracks:
    """Rows are tracks.

    tree (n,): ids, never used again; state (n, 5): x, y m, velocity m/s and stature m; covariance (n, 5, 5); score (n,): existence score, a
    log-likelihood ratio over clutter. hits, misses, age (n,): frames with a box, frames without a box in a row, frames since initiation.
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
        """Speed (n,) m/s."""
        return np.asarray(np.linalg.norm(self.state[:, 2:4], axis=1))

    @property
    def position_sigma(self) -> Array:
        """(n,) m, standard deviation of the place along the major axis."""
        return position_sigma(self.covariance)

    def select(self, rows: Mask | Ints) -> Tracks:
        return Tracks(*(getattr(self, name)[rows] for name in _COLUMNS))

    def join(self, other: Tracks) -> Tracks:
        return Tracks(*(np.concatenate([getattr(self, name), getattr(other, name)]) for name in _COLUMNS))


def position_sigma(covariance: Array) -> Array:
    """(n,) m, standard deviation of the place along the major axis; covariance (n, 5, 5) of states."""
    a, b, c = (covariance[:, i, j] for i, j in ((0, 0), (0, 1), (1, 1)))
    return np.asarray(np.sqrt((a + c) / 2 + np.hypot((a - c) / 2, b)))


_COLUMNS = tuple(Tracks.__dataclass_fields__)

_MEASURED = [0, 1, 4]
"""Columns of a state that boxes measure: place and stature."""


def transition(dt: float, motion: MotionParameters) -> tuple[Array, Array]:
    """Transition F and process noise Q (4, 4) of `dt` seconds with white acceleration (Bar-Shalom, Li, Kirubarajan 2001, eq. 6.2.2-12)."""
    F = np.eye(4)
    F[0, 2] = F[1, 3] = dt
    return F, np.kron(np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]]), np.eye(2)) * motion.acceleration**2


def coasting_transition(misses: Ints, dt: float, motion: MotionParameters) -> tuple[Array, Array]:
    """Transitions F (n, 5, 5) and process noise Q (5, 5) of `dt` seconds, for tracks with so many ticks (n,) without a box.

    As `transition`, except that the velocity of coasting tracks decays like the mean of an Ornstein-Uhlenbeck process. The stature is a random walk.
    """
    F, Q = np.eye(5), np.zeros((5, 5))
    F[:4, :4], Q[:4, :4] = transition(dt, motion)
    Q[4, 4] = motion.stature_drift**2 * dt
    fade = np.exp(-dt / motion.fade_time)
    fading = np.diag([1.0, 1.0, fade, fade, 1.0])
    fading[0, 2] = fading[1, 3] = coasting_time(dt, motion)
    return np.where((misses * dt > motion.fade_after)[:, None, None], fading, F), Q


def coasting_time(gap: float, motion: MotionParameters) -> float:
    """Time, s, in which a constant velocity covers the distance that a decaying one covers in `gap` s."""
    return motion.fade_time * (1 - float(np.exp(-gap / motion.fade_time)))


def predict(tracks: Tracks, dt: float, motion: MotionParameters) -> Tracks:
    """All tracks predicted by `dt` seconds."""
    F, Q = coasting_transition(tracks.misses, dt, motion)
    state = (F @ tracks.state[:, :, None])[:, :, 0]
    return replace(tracks, state=state, covariance=F @ tracks.covariance @ F.transpose(0, 2, 1) + Q, age=tracks.age + 1)


def initiated(first_tree: int, groups: list[CrossViewGroup], motion: MotionParameters, stature: tuple[float, float]) -> Tracks:
    """A new track of each group of boxes, with velocity 0 of large variance; stature: mean and standard deviation of people, m."""
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
class Innovations:
    """All t tracks against all d boxes of a view.

    residual (t, d, 2) rad: direction of the box's feet less the predicted one, along azimuth and elevation, inf for boxes on the other side.
    H (t, 2, 2) rad/m: derivative of the direction by x, y; expected (t, 2, 2) rad²: covariance of the predicted direction.
    height (t, d) m: upper edge of the box over the ground at the track; height_gradient (t, d, 2): its derivative by x, y.
    distance (t,) m: of the feet.
    """

    residual: Array
    H: Array
    expected: Array
    height: Array
    height_gradient: Array
    distance: Array


def innovations(tracks: Tracks, feet: GroundDetections, bias: Array, ground: Ground, motion: MotionParameters) -> Innovations:
    """Innovations of all tracks against all boxes of a view; bias (t, 2) m: the registration bias of the view at each track."""
    place = tracks.state[:, :2]
    z = ground.height_at(place)
    # Slopes are taken over the uncertainty of a place: steeper steps of the ground are finer than what is known of it.
    around = [np.array([0.3, 0.0]), np.array([0.0, 0.3])]
    rise = [(ground.height_at(place + e) - ground.height_at(place - e)) / 0.6 for e in around]
    rays = np.column_stack([place, z]) - feet.origin
    distance = np.maximum(np.linalg.norm(rays, axis=1), 0.2)
    expected = rays / distance[:, None]
    basis = tangent_basis(expected)
    G = np.zeros((len(tracks), 3, 2))
    G[:, 0, 0] = G[:, 1, 1] = 1.0
    G[:, 2, 0], G[:, 2, 1] = rise
    H = basis @ G / distance[:, None, None]
    residual = np.einsum("tij,dj->tdi", basis, feet.direction) - (H @ bias[:, :, None])[:, None, :, 0]
    opposite = expected @ feet.direction.T < 0.5
    residual[opposite] = np.inf
    spread = tracks.covariance[:, :2, :2] + motion.foot_spread**2 * np.eye(2)
    horizontal = np.hypot(rays[:, 0], rays[:, 1])
    slope = np.tan(feet.head_elevation)
    height = feet.origin[2] - z[:, None] + horizontal[:, None] * slope[None, :]
    toward = rays[:, :2] / np.maximum(horizontal, 1e-9)[:, None]
    gradient = toward[:, None, :] * slope[None, :, None] - np.stack(rise, axis=1)[:, None, :]
    return Innovations(residual, H, H @ spread @ H.transpose(0, 2, 1), height, gradient, distance)


class HeadInnovations(NamedTuple):
    """The upper edges of d boxes as measurements of place and stature of t tracks.

    above (t, d) m: height of the box at the track less its stature. H (t, d, 3): its negative derivative by x, y and stature, as `update` needs it.
    noise (t, d) m²: variance of the edge; spread (t, d) m²: variance of `above`.
    """

    above: Array
    H: Array
    noise: Array
    spread: Array

    def within_gate(self, gate: float) -> Mask:
        """Which (t, d) are within `gate` standard deviations."""
        return np.asarray(self.above**2 < gate**2 * self.spread)


def head_innovations(tracks: Tracks, foot: Innovations, feet: GroundDetections, head_sigma: float) -> HeadInnovations:
    """Innovations of the upper edges; foot: those of the feet; head_sigma m: standard deviation of the top of a head from the stature."""
    H = np.concatenate([-foot.height_gradient, np.ones((*foot.height.shape, 1))], axis=2)
    noise = feet.covariance[:, 1, 1] * foot.distance[:, None] ** 2 + head_sigma**2
    spread = np.einsum("tdi,tij,tdj->td", H, tracks.covariance[:, _MEASURED][:, :, _MEASURED], H) + noise
    return HeadInnovations(foot.height - tracks.state[:, 4:], H, noise, spread)


def update(tracks: Tracks, row: int, residual: Array, H: Array, R: Array) -> Tracks:
    """Kalman update, in Joseph form, of the track in `row`: residual (m,), H (m, 2) by x, y or (m, 3) by x, y, stature, and noise R (m, m)."""
    P, full = tracks.covariance[row], np.zeros((len(residual), 5))
    full[:, _MEASURED[: H.shape[1]]] = H
    K = np.linalg.solve(full @ P @ full.T + R, full @ P).T
    A = np.eye(5) - K @ full
    state, covariance = tracks.state.copy(), tracks.covariance.copy()
    state[row] += K @ residual
    covariance[row] = A @ P @ A.T + K @ R @ K.T
    return replace(tracks, state=state, covariance=covariance)


def with_marginal(
    state: Array, covariance: Array, of: tuple[Ints, Array], before: tuple[Array, Array], after: tuple[Array, Array]
) -> tuple[Array, Array]:
    """States (n, 5) and covariances (n, 5, 5) with new marginals.

    of: rows (r,) and A (r, k, 5). A times the states of these rows has mean (r, k) and covariance (r, k, k) `after`, not `before`.
    The other components change by their regression on these, as in a smoother.
    """
    (rows, A), state, covariance = of, state.copy(), covariance.copy()
    P = covariance[rows]
    G = np.linalg.solve(before[1], A @ P).transpose(0, 2, 1)
    state[rows] += (G @ (after[0] - before[0])[:, :, None])[:, :, 0]
    covariance[rows] = P + G @ (after[1] - before[1]) @ G.transpose(0, 2, 1)
    return state, covariance
