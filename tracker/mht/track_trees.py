"""Track trees: all track hypotheses (leaves) of all people in arrays, with a constant-velocity model on the ground, and their fixed-lag smoother.

A row is a leaf: one possible track of one person. It holds the state of a Kalman filter, and past states for the fixed-lag smoother.
All leaves of all trees lie in the same arrays, so that a tick costs a few numpy calls. Nothing is changed in place.

The smoother estimates the frame `delay` frames ago, given all measurements up to now. A leaf remembers its filtered states, and the fixed-interval
smoother passes backwards through them (Rauch, Tung, Striebel 1965, Maximum likelihood estimates of linear dynamic systems).
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace
from typing import final

import numpy as np

from tracker.detections.cross_view import CrossViewGroup
from tracker.geometry import Array, Ints, Mask
from tracker.mht.tick_memory import Step
from tracker.tracks.tracks import MotionParameters, Tracks, coasting_transition


@dataclass(frozen=True, eq=False)
class TrackHypotheses:
    """Rows are n leaves; W is the number of ticks that a leaf remembers, C that of cameras.

    tree (n,): id of the track tree, never used again. state (n, 5): x, y m, velocity m/s, and stature m; covariance (n, 5, 5).
    score (n,): log-likelihood ratio of the whole track against clutter. existence (n,): log-odds that there is a person, by
    boxes and missed detections, without the likelihoods of places. confirmed (n,), deleted (n,): status of the track.
    hits, age (n,): ticks with a box, ticks since initiation. The next times are in revisits (Setup.revisit): ticks where cameras are synchronous.
    misses, out_of_view, unselected (n,): time since the last box, outside all views, outside the global hypothesis.
    due (n,): time since a view could last have detected the person, at most 1. expected_misses (n,): sum since the last box of `due` times the
    probability that some view detects the person.
    node (n, W): ids of the tree's nodes, the latest first. states (n, W, 5) and covariances (n, W, 5, 5): filtered. detected (n, W): with a box.
    past_gaps (n, W): s since the last box before each tick.
    appearance (n, C, d): appearance in each camera, the mean of appearance_count (n, C) boxes; C is 0 while no box has an appearance.
    """

    tree: Ints
    state: Array
    covariance: Array
    score: Array
    existence: Array
    hits: Ints
    misses: Array
    age: Ints
    unselected: Array
    out_of_view: Array
    due: Array
    confirmed: Mask
    deleted: Mask
    node: Ints
    states: Array
    covariances: Array
    detected: Mask
    past_gaps: Array
    expected_misses: Array
    appearance: Array
    appearance_count: Array

    @staticmethod
    def none(window: int) -> TrackHypotheses:
        """No leaf, for a memory of `window` ticks."""
        return initiated(0, [], MotionParameters(), (0.0, 0.0), (window, 0, 0))

    def __len__(self) -> int:
        return len(self.tree)

    @property
    def position_sigma(self) -> Array:
        """(n,) m, standard deviation of the place along the major axis."""
        return position_sigma(self.covariance)

    @property
    def speed(self) -> Array:
        """(n,) m/s."""
        return np.asarray(np.linalg.norm(self.state[:, 2:4], axis=1))

    def select(self, rows: Mask | Ints) -> TrackHypotheses:
        """The leaves in those rows."""
        return TrackHypotheses(*(getattr(self, name)[rows] for name in _COLUMNS))

    def join(self, other: TrackHypotheses) -> TrackHypotheses:
        """The leaves of both."""
        return TrackHypotheses(*(np.concatenate([getattr(self, name), getattr(other, name)]) for name in _COLUMNS))


_COLUMNS = tuple(TrackHypotheses.__dataclass_fields__)
_REMEMBERED = ("node", "states", "covariances", "detected", "past_gaps")


def position_sigma(covariance: Array) -> Array:
    """(n,) m, standard deviation of the place along the major axis; covariance (n, 5, 5) of states."""
    a, b, c = (covariance[:, i, j] for i, j in ((0, 0), (0, 1), (1, 1)))
    return np.asarray(np.sqrt((a + c) / 2 + np.hypot((a - c) / 2, b)))


def initiated(
    first_tree: int, groups: list[CrossViewGroup], motion: MotionParameters, stature: tuple[float, float], size: tuple[int, int, int]
) -> TrackHypotheses:
    """One new tree per group of boxes, with a velocity of mean 0.

    stature: mean and standard deviation of people, m; size: ticks of memory, number of cameras, and length of an appearance vector.
    """
    n, (window, cameras, length) = len(groups), size
    state, covariance = np.zeros((n, 5)), np.zeros((n, 5, 5))
    for k, group in enumerate(groups):
        state[k, :2] = group.point
        covariance[k, :2, :2] = group.covariance
    covariance[:, 2, 2] = covariance[:, 3, 3] = motion.start_speed**2
    state[:, 4], covariance[:, 4, 4] = stature[0], stature[1] ** 2
    zero, ones, no = np.zeros(n), np.ones(n, np.int64), np.zeros(n, dtype=bool)
    states, covariances, detected = np.zeros((n, window, 5)), np.zeros((n, window, 5, 5)), np.zeros((n, window), dtype=bool)
    states[:, 0], covariances[:, 0], detected[:, 0] = state, covariance, True
    node = np.full((n, window), -1, dtype=np.int64)
    appearance = np.zeros((n, cameras, length)), np.zeros((n, cameras))
    return TrackHypotheses(
        first_tree + np.arange(n), state, covariance, zero, zero, ones, zero, ones, zero, zero, zero, no, no,
        node, states, covariances, detected, np.zeros((n, window)), zero, *appearance,
    )  # fmt: skip


def predict(tracks: TrackHypotheses, step: Step, motion: MotionParameters) -> TrackHypotheses:
    """All leaves predicted by a step in time; their memory moves by one tick."""
    gaps = tracks.misses * step.revisit
    F, Q = coasting_transition(gaps, step.seconds, motion)
    columns = min(tracks.node.shape[1], step.window - 1)
    memory = {name: np.zeros((len(tracks), step.window, *getattr(tracks, name).shape[2:]), getattr(tracks, name).dtype) for name in _REMEMBERED}
    memory["node"][:] = -1
    for name, values in memory.items():
        values[:, 1 : columns + 1] = getattr(tracks, name)[:, :columns]
    memory["past_gaps"][:, 0] = gaps
    state, due = (F @ tracks.state[:, :, None])[:, :, 0], np.minimum(tracks.due + step.revisits, 1.0)
    return replace(tracks, state=state, covariance=F @ tracks.covariance @ F.transpose(0, 2, 1) + Q, age=tracks.age + 1, due=due, **memory)


def coasted(predicted: TrackHypotheses, step: Step) -> TrackHypotheses:
    """Predicted leaves after a tick without views. Nobody could be detected, so the global hypothesis stays the same."""
    memory = {name: getattr(predicted, name).copy() for name in ("node", "states", "covariances")}
    memory["states"][:, 0], memory["covariances"][:, 0] = predicted.state, predicted.covariance
    if step.window > 1:
        memory["node"][:, 0] = memory["node"][:, 1]
    return replace(predicted, misses=predicted.misses + step.revisits, **memory)


def survived(existence: Array, leaving: float) -> Array:
    """Existence (n,), log-odds, after a time in which a person leaves with probability `leaving`, below 1 (Bernoulli filter: Ristic et al. 2013)."""
    return np.asarray(np.log1p(-leaving) - np.logaddexp(-existence, np.log(leaving)))


@final
class MhtFixedLagSmoother:
    """The people of `delay` frames ago, from the memory of the tracks in the global hypothesis. A delay of 0 reports at once."""

    def __init__(self, delay: int, motion: MotionParameters, hidden_sigma: float) -> None:
        """hidden_sigma m: hidden people who are not seen again are reported up to this standard deviation of the place.

        Raises ValueError where delay is below 0.
        """
        if delay < 0:
            raise ValueError(f"delay is {delay} frames, needs 0 or more")
        self.delay, self.motion, self.hidden_sigma = delay, motion, hidden_sigma
        self._waiting: deque[int] = deque()  # for each frame that is not reported yet, the number of ticks up to it
        self._steps: deque[float] = deque()  # s before each tick after the oldest of these frames, the latest last
        self._taken = 0
        self._last: tuple[TrackHypotheses, Mask] | None = None

    def feed(self, tracks: TrackHypotheses, present: Mask, seconds: float, reported: bool = True) -> Tracks | None:
        """Take the tracks (n,) after a tick, and which are present. Returns the people `delay` frames before, None at the start.

        seconds: since the tick before. reported: whether the tick ends a frame; the result of other ticks is None.
        """
        self._taken += 1
        self._steps.append(seconds)
        self._last = tracks, present
        if reported:
            self._waiting.append(self._taken)
        return self.drain() if reported and len(self._waiting) > self.delay else None

    def drain(self) -> Tracks | None:
        """The people of the oldest frame that is not reported yet; None where all are."""
        if self._last is None or not self._waiting:
            return None
        ago = self._taken - self._waiting.popleft()
        while len(self._steps) > ago:
            self._steps.popleft()
        return self._people(ago)

    def current(self) -> Tracks:
        """The people of the last tick, as a delay of 0 reports them. Raises ValueError before the first."""
        if self._last is None:
            raise ValueError("no tick was taken, needs one at least")
        return self._people(0)

    def _people(self, ago: int) -> Tracks:
        """The people of `ago` ticks before the last."""
        assert self._last is not None
        tracks, present = self._last
        # A person was there if detected at that tick or later, if still present, or if hidden while the place was still known.
        hidden = ~tracks.deleted & (tracks.out_of_view == 0) & (position_sigma(tracks.covariances[:, ago]) <= self.hidden_sigma)
        there = (tracks.age > ago) & tracks.confirmed & (present | hidden | tracks.detected[:, : ago + 1].any(axis=1))
        return smoothed(tracks.select(there), list(self._steps)[::-1][:ago], self.motion)


def smoothed(tracks: TrackHypotheses, steps: list[float], motion: MotionParameters) -> Tracks:
    """The smoothed tracks `len(steps)` ticks ago; all tracks must be older. steps: s from the tick before to each tick, the latest first."""
    x, P = tracks.states[:, 0], tracks.covariances[:, 0]
    for k, seconds in enumerate(steps, 1):
        (F, Q), state, covariance = coasting_transition(tracks.past_gaps[:, k - 1], seconds, motion), tracks.states[:, k], tracks.covariances[:, k]
        predicted = F @ covariance @ F.transpose(0, 2, 1) + Q
        C = np.linalg.solve(predicted, F @ covariance).transpose(0, 2, 1)
        x = state + (C @ (x[:, :, None] - F @ state[:, :, None]))[:, :, 0]
        P = covariance + C @ (P - predicted) @ C.transpose(0, 2, 1)
    return Tracks(tracks.tree, x, P, tracks.score, tracks.misses)
