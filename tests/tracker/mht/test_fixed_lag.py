"""The fixed-lag smoother: every tick is reported once, by all that came since, and smoothing is the batch estimate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from tracker.detections.cross_view import CrossViewGroup
from tracker.mht.tick_memory import Step
from tracker.mht.track_trees import MhtFixedLagSmoother, TrackHypotheses, initiated, predict
from tracker.tracks.tracks import FADE_TIME, MotionParameters, coasting_transition, transition

MOTION = MotionParameters(acceleration=0.8, start_speed=1.0)
PERIOD = 0.2
FIRST = np.diag([4.0, 4.0, 1.0, 1.0, 0.01])
"""Covariance of the prior."""
R = 0.09 * np.eye(2)
"""m², covariance of the measurements."""


def measurements(rng: np.random.Generator, steps: int, unseen: Sequence[int] = ()) -> np.ndarray:
    """Measured places (steps, 2) m of one walker, NaN in the steps `unseen`."""
    x, out = np.array([0.0, 0.0, 1.0, 0.3]), []
    F, Q = transition(PERIOD, MOTION)
    for k in range(steps):
        if k:
            x = F @ x + np.linalg.cholesky(Q + 1e-12 * np.eye(4)) @ rng.normal(size=4)
        out.append(np.full(2, np.nan) if k in unseen else x[:2] + rng.normal(0, 0.3, 2))
    return np.array(out)


def people(tree: list[int], window: int) -> TrackHypotheses:
    """One new leaf of each tree at the origin, that remembers `window` ticks."""
    leaves = initiated(0, [CrossViewGroup(((0, 0),), np.zeros(2), FIRST[:2, :2])] * len(tree), MOTION, (0.0, 0.1), (window, 0, 0))
    return replace(leaves, tree=np.array(tree))


def step(window: int) -> Step:
    """A period, of which so many ticks are remembered."""
    return Step(PERIOD, PERIOD, 0.0, 0, window)


def filtered(measured: np.ndarray) -> list[TrackHypotheses]:
    """A Kalman filter on the measurements (n, 2), NaN where there is none: its confirmed leaf after each of them."""
    leaf, H, out = people([7], len(measured)), np.eye(2, 5), []
    leaf = replace(leaf, confirmed=np.ones(1, dtype=bool))
    for k, z in enumerate(measured):
        if k:
            leaf = predict(leaf, step(len(measured)), MOTION)
        state, P, seen = leaf.state[0], leaf.covariance[0], np.isfinite(z).all()
        if seen:
            K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
            state, P = state + K @ (z - H @ state), P - K @ H @ P
        states, covariances, detected = leaf.states.copy(), leaf.covariances.copy(), leaf.detected.copy()
        states[:, 0], covariances[:, 0], detected[:, 0] = state, P, seen
        misses = np.where(seen, 0, leaf.misses + 1)
        leaf = replace(leaf, state=state[None], covariance=P[None], states=states, covariances=covariances, detected=detected, misses=misses)
        out.append(leaf)
    return out


PRESENT = np.ones(1, dtype=bool)


@pytest.mark.parametrize("unseen", [(), range(2, 9)])
def test_the_smoothed_state_is_the_batch_estimate(unseen: Sequence[int]) -> None:
    steps = 12
    measured = measurements(np.random.default_rng(0), steps, unseen)
    leaves, lag = filtered(measured), MhtFixedLagSmoother(steps - 1, MOTION, 1.0)
    reported = [lag.feed(leaf, PRESENT, PERIOD) for leaf in leaves]
    assert all(tracks is None for tracks in reported[:-1])
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
            (F,), Q = coasting_transition(leaves[k - 1].misses * PERIOD, PERIOD, MOTION)
            A = np.zeros((5, 5 * steps))
            A[:, 5 * k - 5 : 5 * k], A[:, 5 * k : 5 * k + 5] = -F, np.eye(5)
            information += A.T @ np.linalg.solve(Q, A)
    np.testing.assert_allclose(first.state[0], np.linalg.solve(information, vector)[:5], atol=1e-6)
    np.testing.assert_allclose(first.covariance[0], np.linalg.inv(information)[:5, :5], atol=1e-6)


@pytest.mark.parametrize("delay", [0, 3, 20])
def test_every_tick_is_reported_once(delay: int) -> None:
    leaves = filtered(measurements(np.random.default_rng(1), 10))
    lag = MhtFixedLagSmoother(delay, MOTION, 1.0)
    reported = [tracks for leaf in leaves if (tracks := lag.feed(leaf, PRESENT, PERIOD)) is not None]
    assert len(reported) == max(0, 10 - delay)
    while (tracks := lag.drain()) is not None:
        reported.append(tracks)
    assert len(reported) == 10
    np.testing.assert_allclose(reported[-1].state, leaves[-1].state)


def test_without_a_delay_nothing_is_changed() -> None:
    lag = MhtFixedLagSmoother(0, MOTION, 1.0)
    for leaf in filtered(measurements(np.random.default_rng(2), 5)):
        tracks = lag.feed(leaf, PRESENT, PERIOD)
        assert tracks is not None
        np.testing.assert_array_equal(tracks.state, leaf.state)


def test_tracks_confirmed_later_and_coasting_tracks_that_are_not_deleted_are_reported() -> None:
    def after(leaves: TrackHypotheses, detected: list[bool]) -> TrackHypotheses:
        later = predict(leaves, step(4), MOTION)
        later.detected[:, 0] = detected
        return later

    lag = MhtFixedLagSmoother(2, MOTION, 1.0)
    first = people([1, 2, 3, 4], 4)
    first.detected[:, 0] = [True, False, False, False]
    assert lag.feed(first, np.zeros(4, dtype=bool), PERIOD) is None
    second = after(first, [True, True, False, False])
    assert lag.feed(second, np.zeros(4, dtype=bool), PERIOD) is None
    last = replace(after(second, [True, True, False, False]), confirmed=np.ones(4, dtype=bool), deleted=np.array([False, False, False, True]))
    tracks = lag.feed(last, np.array([True, True, True, False]), PERIOD)
    assert tracks is not None
    # 1 is confirmed later, 2 has a box again, 3 coasts, 4 is deleted while coasting.
    assert tracks.tree.tolist() == [1, 2, 3]


def test_a_person_is_reported_until_the_place_is_too_uncertain() -> None:
    """Hidden from the fourth tick on and not present at the end: reported while the place was known, unless deleted or outside all views."""
    leaves = filtered(measurements(np.random.default_rng(4), 16, range(3, 16)))
    sigma = np.sqrt([np.linalg.eigvalsh(leaf.covariance[0, :2, :2])[-1] for leaf in leaves])
    known = int((sigma <= 1.0).sum())
    assert 3 < known < 16

    def reported(last: TrackHypotheses) -> int:
        lag = MhtFixedLagSmoother(15, MOTION, 1.0)
        for leaf in leaves[:-1]:
            assert lag.feed(leaf, ~PRESENT, PERIOD) is None
        first = lag.feed(last, ~PRESENT, PERIOD)
        assert first is not None
        return len(first) + sum(len(tracks) for tracks in iter(lag.drain, None))

    assert reported(leaves[-1]) == known
    assert reported(replace(leaves[-1], deleted=PRESENT)) == 3
    assert reported(replace(leaves[-1], out_of_view=np.array([2]))) == 3


def test_a_track_is_not_reported_before_its_initiation() -> None:
    lag, new = MhtFixedLagSmoother(1, MOTION, 1.0), replace(people([1], 3), confirmed=PRESENT)
    assert lag.feed(people([], 3), np.zeros(0, dtype=bool), PERIOD) is None
    before = lag.feed(new, PRESENT, PERIOD)
    assert before is not None
    assert before.tree.tolist() == []
    at = lag.drain()
    assert at is not None
    assert at.tree.tolist() == [1]


def test_a_coasting_track_comes_to_a_halt() -> None:
    walkers = people([1, 2], 2)
    walkers.state[:] = [0.0, 0.0, 1.2, 0.0, 1.7]
    for k in range(40):
        walkers = predict(replace(walkers, misses=np.array([0.0, k])), step(2), MOTION)
    seen, unseen = walkers.state
    np.testing.assert_allclose(seen[0], 40 * PERIOD * 1.2)
    # Constant velocity until FADE_AFTER, and then the distance that a velocity of time constant FADE_TIME covers.
    np.testing.assert_allclose(unseen[0], (3 * PERIOD + FADE_TIME) * 1.2, atol=0.01)
    assert np.linalg.norm(unseen[2:4]) < 0.01
    assert unseen[4] == seen[4] == 1.7


def test_a_negative_delay_is_refused() -> None:
    with pytest.raises(ValueError, match="delay is -1 frames"):
        MhtFixedLagSmoother(-1, MOTION, 1.0)
