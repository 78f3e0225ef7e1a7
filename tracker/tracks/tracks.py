"""Tracks of people on the ground: state, motion model, new marginals of places, and ids as they are reported.

The state holds place, velocity and stature. All tracks are rows of arrays, so that a crowd costs a few numpy calls. Functions return new values;
nothing is changed in place. Each tree has one reported id, and a new one after it has left the area.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from tracker.geometry import Array, Ints, Mask
from tracker.types import Setup
from tracker.types.ticks import ROUNDING

STATURE_WALK = 0.005
"""m/√s, random walk of the apparent stature."""

FADE_AFTER, FADE_TIME = 0.4, 1.0
"""s without a box after which the velocity of a coasting track decays, and the time constant of that decay: hidden people often stop or turn."""


@dataclass(frozen=True)
class MotionParameters:
    """Motion of people."""

    acceleration: float = 0.5  # m/s^1.5, square root of the growth of the velocity's variance per second
    start_speed: float = 1.0  # m/s, standard deviation of an unknown velocity, per axis
    foot_spread: float = 0.15  # m, standard deviation of the feet from the ground under the body
    v_max: float = 3.0  # m/s, a faster track is deleted: it consists of false boxes or of several people's


@dataclass(frozen=True, eq=False)
class Tracks:
    """Rows are tracks.

    tree (n,): ids, never used again; state (n, 5): x, y m, velocity m/s and stature m; covariance (n, 5, 5); score (n,):
    log-likelihood ratio over clutter. misses (n,): time since the last box, in revisits (Setup.revisit): ticks where cameras are synchronous.
    """

    tree: Ints
    state: Array
    covariance: Array
    score: Array
    misses: Array

    def __len__(self) -> int:
        return len(self.tree)

    def select(self, rows: Mask | Ints) -> Tracks:
        """The tracks in those rows."""
        return Tracks(*(getattr(self, name)[rows] for name in _COLUMNS))


_COLUMNS = tuple(Tracks.__dataclass_fields__)


@lru_cache(maxsize=64)
def transition(dt: float, motion: MotionParameters) -> tuple[Array, Array]:
    """Transition F and process noise Q (4, 4) of `dt` seconds with white acceleration (Bar-Shalom, Li, Kirubarajan 2001, eq. 6.2.2-12).

    The same arguments give the same arrays, which are not to be changed.
    """
    F = np.eye(4)
    F[0, 2] = F[1, 3] = dt
    return F, np.kron(np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]]), np.eye(2)) * motion.acceleration**2


def coasting_transition(gap: Array, dt: float, motion: MotionParameters) -> tuple[Array, Array]:
    """Transitions F (n, 5, 5) and process noise Q (5, 5) of `dt` seconds, for tracks that had no box for `gap` (n,) s before.

    As `transition`, except that the velocity of coasting tracks decays like the mean of an Ornstein-Uhlenbeck process. The stature is a random walk.
    """
    F, fading, Q = _transitions(dt, motion)
    return np.where((gap > FADE_AFTER)[:, None, None], fading, F), Q


@lru_cache(maxsize=64)
def _transitions(dt: float, motion: MotionParameters) -> tuple[Array, Array, Array]:
    """Transitions (5, 5) without and with decay, and process noise Q (5, 5)."""
    F, Q = np.eye(5), np.zeros((5, 5))
    F[:4, :4], Q[:4, :4] = transition(dt, motion)
    Q[4, 4] = STATURE_WALK**2 * dt
    fade = np.exp(-dt / FADE_TIME)
    fading = np.diag([1.0, 1.0, fade, fade, 1.0])
    fading[0, 2] = fading[1, 3] = coasting_time(dt)
    return F, fading, Q


def coasting_time(gap: float) -> float:
    """Time, s, in which a constant velocity covers the distance that a decaying one covers in `gap` s."""
    return FADE_TIME * (1 - float(np.exp(-gap / FADE_TIME)))


class Places(NamedTuple):
    """Normal distributions of r places: mean (r, 2) m and covariance (r, 2, 2) m²."""

    mean: Array
    covariance: Array


def with_places(state: Array, covariance: Array, rows: Ints, before: Places, after: Places) -> tuple[Array, Array]:
    """States (n, 5) and covariances (n, 5, 5); the places in `rows` (r,) are distributed as `after`, not as `before`.

    The other components change by their regression on the places, as in a smoother.
    """
    state, covariance = state.copy(), covariance.copy()
    P = covariance[rows]
    G = np.linalg.solve(before.covariance, P[:, :2]).transpose(0, 2, 1)
    state[rows] += (G @ (after.mean - before.mean)[:, :, None])[:, :, 0]
    covariance[rows] = P + G @ (after.covariance - before.covariance) @ G.transpose(0, 2, 1)
    return state, covariance


EXIT_DISTANCE = 1.0
"""m beyond the area from which a person has left it. Errors of places are half of that, so that a person on the edge keeps the id."""
EXIT_TIME = 3.0
"""s outside the area after which a person has left it, at any distance."""


class TrackIds:
    """The id of each tree. Ids count from 1 and are never used again."""

    def __init__(self, setup: Setup) -> None:
        self.setup = setup
        self._ids: dict[int, int] = {}
        self._outside_since: dict[int, float] = {}  # tree → s
        self._next = 1

    def report(self, people: Tracks, time: float) -> tuple[Ints, Array, Array]:
        """Ids (k,), places on the ground (k, 3) m and covariances (k, 3, 3) of the people in the area at `time` s."""
        beyond = self.setup.distance_beyond(people.state)
        for tree, far in zip(people.tree.tolist(), beyond.tolist(), strict=True):
            if far > 0:
                self._outside_since.setdefault(tree, time)
            # Ticks without the track count, too.
            if far >= EXIT_DISTANCE or time - self._outside_since.get(tree, time) > EXIT_TIME + ROUNDING:
                self._ids.pop(tree, None)
            if far <= 0:
                self._outside_since.pop(tree, None)
                if tree not in self._ids:
                    self._ids[tree], self._next = self._next, self._next + 1
        chosen = people.select(beyond <= 0)
        covariance = np.zeros((len(chosen), 3, 3))
        covariance[:, :2, :2] = chosen.covariance[:, :2, :2]
        ids = np.array([self._ids[tree] for tree in chosen.tree.tolist()], dtype=np.int64)
        return ids, np.column_stack([chosen.state[:, :2], self.setup.ground.height_at(chosen.state[:, :2])]), covariance
