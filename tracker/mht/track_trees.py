"""Track trees of people on the ground: constant velocity, seen as directions by any number of views.

A row is a leaf: one way in which one person may have gone, with all that is needed to go on and to tell of its last moments. All leaves of all
trees are held in arrays, so that a crowd costs a few numpy calls; nothing is changed in place.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tracker.detections.appearance import SIZE
from tracker.detections.cross_view import CrossViewGroup
from tracker.geometry import Array, Ints, Mask
from tracker.tracks.tracks import MotionParameters, onward


@dataclass(frozen=True, eq=False)
class TrackHypotheses:
    """Rows are leaves, n of them; W is how many ticks a leaf remembers.

    tree (n,): the id, never used again. state (n, 4) x, y m and velocity m/s, covariance (n, 4, 4). score (n,): log-likelihood ratio of the whole
    track against clutter; alive (n,): the same with a memory that ends, for and against that somebody is there. hits, misses, age, out (n,): ticks
    seen in all, unseen in a row, since birth, since the best hypothesis held it; due (n,): in how many of those unseen in a row some view should
    have shown it; away (n,): ticks out of all views. believed (n,): it was certain once. over (n,): it has ended.
    node (n, W), past (n, W, 4), spread (n, W, 4, 4), met (n, W): names of the branches that led here, filtered states and whether a box was taken,
    the latest first. gap (n, W): ticks unseen in a row before each; before (n, W): scores.
    appearance (n, C, d): what each camera's boxes of the person look like (appearance.appearances), of worn (n, C) boxes; C is 0 without images.
    """

    tree: Ints
    state: Array
    covariance: Array
    score: Array
    alive: Array
    hits: Ints
    misses: Ints
    age: Ints
    out: Ints
    away: Ints
    believed: Mask
    over: Mask
    node: Ints
    past: Array
    spread: Array
    met: Mask
    gap: Ints
    before: Array
    due: Array
    appearance: Array
    worn: Array

    @staticmethod
    def none(window: int) -> TrackHypotheses:
        """No leaf, for a memory of `window` ticks."""
        return initiated(0, [], MotionParameters(), window)

    def __len__(self) -> int:
        return len(self.tree)

    @property
    def speed(self) -> Array:
        """(n,) m/s."""
        return np.asarray(np.linalg.norm(self.state[:, 2:], axis=1))

    def select(self, rows: Mask | Ints) -> TrackHypotheses:
        """The leaves in those rows."""
        return TrackHypotheses(*(getattr(self, name)[rows] for name in _COLUMNS))

    def join(self, other: TrackHypotheses) -> TrackHypotheses:
        """The leaves of both."""
        return TrackHypotheses(*(np.concatenate([getattr(self, name), getattr(other, name)]) for name in _COLUMNS))


_COLUMNS = tuple(TrackHypotheses.__dataclass_fields__)


def _fresh(tree: Ints, state: Array, covariance: Array, size: tuple[int, int]) -> TrackHypotheses:
    n, (window, cameras) = len(tree), size
    zero, ones, no = np.zeros(n, np.int64), np.ones(n, np.int64), np.zeros(n, dtype=bool)
    past, spread, met = np.zeros((n, window, 4)), np.zeros((n, window, 4, 4)), np.zeros((n, window), dtype=bool)
    past[:, 0], spread[:, 0], met[:, 0] = state, covariance, True
    node = np.full((n, window), -1, dtype=np.int64)
    dress = np.zeros((n, cameras, SIZE)), np.zeros((n, cameras))
    return TrackHypotheses(
        tree, state, covariance, np.zeros(n), np.zeros(n), ones, zero, ones, zero, zero, no, no, node, past, spread, met, 0 * node,
        np.zeros((n, window)), np.zeros(n), *dress,
    )  # fmt: skip


def predict(tracks: TrackHypotheses, dt: float, motion: MotionParameters) -> TrackHypotheses:
    """All leaves `dt` seconds on; what they remember is one tick older, and the latest place in it is open."""
    F, Q = going(tracks.misses, dt, motion)
    aged = {name: np.roll(getattr(tracks, name), 1, axis=1) for name in ("node", "past", "spread", "met", "gap", "before")}
    aged["gap"][:, 0], aged["before"][:, 0] = tracks.misses, tracks.score
    state = (F @ tracks.state[:, :, None])[:, :, 0]
    return replace(tracks, state=state, covariance=F @ tracks.covariance @ F.transpose(0, 2, 1) + Q, age=tracks.age + 1, **aged)


def going(misses: Ints, dt: float, motion: MotionParameters) -> tuple[Array, Array]:
    """F (n, 4, 4) and Q (4, 4) of trees.onward, without statures."""
    F, Q = onward(misses, dt, motion)
    return F[:, :4, :4], Q[:4, :4]


def initiated(first_tree: int, groups: list[CrossViewGroup], motion: MotionParameters, window: int, cameras: int = 0) -> TrackHypotheses:
    """One new tree a combination, at rest with an unknown velocity; window: ticks of memory; cameras: whose images show what people look like."""
    n = len(groups)
    state, covariance = np.zeros((n, 4)), np.zeros((n, 4, 4))
    for k, group in enumerate(groups):
        state[k, :2] = group.point
        covariance[k, :2, :2] = group.covariance
    covariance[:, 2, 2] = covariance[:, 3, 3] = motion.start_speed**2
    return _fresh(first_tree + np.arange(n), state, covariance, (window, cameras))


def weights(tracks: TrackHypotheses, most: float) -> Array:
    """Weight (n,) of each leaf as a vertex: what the ticks say for it that are not decided yet, and its score before them, but at most `most`, twice
    as much where believed.

    A tree that has lived for long has a score that nothing could outweigh, and a search over sums that large would see no difference. What came
    since counts in full: else a leaf that lost to another of its tree for some ticks, as that of somebody does who is out of sight beside others,
    would weigh nothing, and its tree could be held only by a leaf that takes what belongs to others.
    """
    before = tracks.before[:, -1]
    return np.asarray(tracks.score - before + np.minimum(before, np.where(tracks.believed, 2 * most, most)))
