"""The fixed-lag smoother: every tick is reported once, by all that came since, and smoothing is the batch estimate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from tracker.gnn.fixed_lag import GnnFixedLagSmoother
from tracker.tracks.tracks import MotionParameters, Tracks, coasting_transition, predict, transition

MOTION = MotionParameters(acceleration=0.8)
PERIOD = 0.2
FIRST = np.diag([4.0, 4.0, 1.0, 1.0, 0.01])
"""Covariance of the prior."""


def hidden(tracks: Tracks) -> np.ndarray:
    """All views miss everybody."""
    return np.ones(len(tracks))


def tracks_of(tree: list[int], state: np.ndarray, covariance: np.ndarray, misses: list[int]) -> Tracks:
    n = len(tree)
    ones = np.ones(n, dtype=np.int64)
    return Tracks(np.array(tree), state.reshape(n, 5), covariance.reshape(n, 5, 5), np.zeros(n), ones, np.array(misses), ones)


def filtered(rng: np.random.Generator, steps: int, unseen: Sequence[int] = ()) -> tuple[list[Tracks], np.ndarray, np.ndarray]:
    """A Kalman filter on places of one walker: its tracks, the measurements (steps, 2), NaN in the steps `unseen`, their covariance."""
    R = 0.09 * np.eye(2)
    x = np.array([0.0, 0.0, 1.0, 0.3])
    H = np.eye(2, 5)
    state, P, misses = np.zeros(5), FIRST, 0
    out: list[Tracks] = []
    measured = []
    for k in range(steps):
        if k:
            F, Q = transition(PERIOD, MOTION)
            x = F @ x + np.linalg.cholesky(Q + 1e-12 * np.eye(4)) @ rng.normal(size=4)
            now = predict(out[-1], PERIOD, MOTION)
            state, P = now.state[0], now.covariance[0]
        z = x[:2] + rng.normal(0, 0.3, 2)
        misses = misses + 1 if k in unseen else 0
        if misses:
            z = np.full(2, np.nan)
        else:
            K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
            state, P = state + K @ (z - H @ state), P - K @ H @ P
        measured.append(z)
        out.append(tracks_of([7], state, P, [misses]))
    return out, np.array(measured), R


@pytest.mark.parametrize("unseen", [(), range(2, 9)])
def test_the_smoothed_state_is_the_batch_estimate(unseen: Sequence[int]) -> None:
    steps = 12
    tracks, measured, R = filtered(np.random.default_rng(0), steps, unseen)
    lag = GnnFixedLagSmoother(steps - 1, PERIOD, MOTION)
    reported = [lag.feed(t, np.ones(1, dtype=bool), hidden) for t in tracks]
    assert all(people is None for people in reported[:-1])
    first = reported[-1]
    assert first is not None
    # The same by least squares over all states at once: prior, motion and measurements.
    information, vector = np.zeros((5 * steps, 5 * steps)), np.zeros(5 * steps)
    information[:5, :5] += np.linalg.inv(FIRST)
    for k in range(steps):
        if k not in unseen:
            information[5 * k : 5 * k + 2, 5 * k : 5 * k + 2] += np.linalg.inv(R)
            vector[5 * k : 5 * k + 2] += np.linalg.solve(R, measured[k])
        if k:
            (F,), Q = coasting_transition(tracks[k - 1].misses, PERIOD, MOTION)
            A = np.zeros((5, 5 * steps))
            A[:, 5 * k - 5 : 5 * k], A[:, 5 * k : 5 * k + 5] = -F, np.eye(5)
            information += A.T @ np.linalg.solve(Q, A)
    np.testing.assert_allclose(first.state[0], np.linalg.solve(information, vector)[:5], atol=1e-6)
    np.testing.assert_allclose(first.covariance[0], np.linalg.inv(information)[:5, :5], atol=1e-6)


@pytest.mark.parametrize("delay", [0, 3, 20])
def test_every_tick_is_reported_once(delay: int) -> None:
    tracks, _, _ = filtered(np.random.default_rng(1), 10)
    lag = GnnFixedLagSmoother(delay, PERIOD, MOTION)
    reported = [people for t in tracks if (people := lag.feed(t, np.ones(1, dtype=bool), hidden)) is not None]
    assert len(reported) == max(0, 10 - delay)
    while (people := lag.drain()) is not None:
        reported.append(people)
    assert len(reported) == 10
    np.testing.assert_allclose(reported[-1].state, tracks[-1].state)


def test_without_a_delay_nothing_is_changed() -> None:
    tracks, _, _ = filtered(np.random.default_rng(2), 5)
    lag = GnnFixedLagSmoother(0, PERIOD, MOTION)
    for t in tracks:
        people = lag.feed(t, np.ones(1, dtype=bool), hidden)
        assert people is not None
        np.testing.assert_array_equal(people.state, t.state)


def test_tracks_confirmed_later_and_coasting_tracks_that_are_not_deleted_are_reported() -> None:
    state, P = np.zeros((4, 5)), np.tile(np.eye(5), (4, 1, 1))
    lag = GnnFixedLagSmoother(2, PERIOD, MOTION)
    now = replace(tracks_of([1, 2, 3, 4], state, P, [0, 4, 4, 4]), hits=np.full(4, 40))
    later = predict(tracks_of([1, 2, 3, 4], state, P, [0, 0, 5, 5]), PERIOD, MOTION)
    assert lag.feed(now, np.array([False, True, True, True]), hidden) is None
    lag.feed(later, np.array([True, True, True, True]), hidden)
    people = lag.feed(later.select(np.array([0, 1, 2])), np.array([True, True, False]), hidden)
    assert people is not None
    # 1 is confirmed later, 2 has a box again, 3 coasts, 4 is deleted while coasting.
    assert people.tree.tolist() == [1, 2, 3]


def test_a_track_deleted_after_a_short_time_is_not_reported() -> None:
    state, P = np.zeros((2, 5)), np.tile(np.eye(5), (2, 1, 1))
    lag = GnnFixedLagSmoother(1, PERIOD, MOTION)
    now, both = tracks_of([1, 2], state, P, [0, 0]), np.ones(2, dtype=bool)
    now = replace(now, hits=np.array([3, 40]))
    assert lag.feed(now, both, hidden) is None
    people = lag.feed(now.select(np.zeros(0, dtype=np.int64)), np.zeros(0, dtype=bool), hidden)
    assert people is not None
    assert people.tree.tolist() == [2]


@pytest.mark.parametrize(("nobody", "first"), [(1.0, 3), (0.01, 5)])
def test_people_are_reported_before_their_first_box_unless_views_would_have_detected_them(nobody: float, first: int) -> None:
    tracks, _, _ = filtered(np.random.default_rng(3), 20)
    lag = GnnFixedLagSmoother(10, 1 / 7, MOTION)
    reported = [
        lag.feed(t if k >= 5 else Tracks.none(), np.ones(len(t) if k >= 5 else 0, dtype=bool), lambda who: np.full(len(who), nobody))
        for k, t in enumerate(tracks)
    ][10:]
    assert [len(people) for people in reported if people is not None] == [k >= first for k in range(10)]
    for early, later in pairwise([people for people in reported if people is not None and len(people)]):
        # Places before the first box are extrapolated back.
        np.testing.assert_allclose(later.state[0, :2] - early.state[0, :2], early.state[0, 2:4] / 7, atol=0.05)
        assert early.tree == later.tree == 7


def test_a_coasting_track_comes_to_a_halt() -> None:
    walker = tracks_of([1, 2], np.array([[0.0, 0.0, 1.2, 0.0, 1.7]] * 2), np.array([0.1 * np.eye(5)] * 2), [0, 0])
    for k in range(40):
        walker = predict(replace(walker, misses=np.array([0, k])), PERIOD, MOTION)
    seen, unseen = walker.state
    np.testing.assert_allclose(seen[0], 40 * PERIOD * 1.2)
    # Constant velocity until `fade_after`, and then the distance that a velocity of time constant `fade_time` covers.
    np.testing.assert_allclose(unseen[0], (3 * PERIOD + MOTION.fade_time) * 1.2, atol=0.01)
    assert np.linalg.norm(unseen[2:4]) < 0.01
    assert unseen[4] == seen[4] == 1.7


def test_a_negative_delay_is_refused() -> None:
    with pytest.raises(ValueError, match="delay is -1 ticks"):
        GnnFixedLagSmoother(-1, PERIOD, MOTION)
