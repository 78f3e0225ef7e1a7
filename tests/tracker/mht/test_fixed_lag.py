"""Fixed-lag smoothing of track hypotheses: the same result as that of the other tracker for the same measurements."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from tests.tracker.gnn.test_fixed_lag import FIRST, MOTION, PERIOD, filtered, hidden
from tracker.detections.cross_view import CrossViewGroup
from tracker.gnn.fixed_lag import GnnFixedLagSmoother
from tracker.mht.fixed_lag import smoothed
from tracker.mht.track_trees import TrackHypotheses, initiated, predict

STEPS = 12


def remembered(measured: np.ndarray, R: np.ndarray) -> TrackHypotheses:
    """A leaf that took the measurements (n, 2), none where they are NaN, by the filter of tests/tracker/gnn/test_fixed_lag.py."""
    leaf, H = initiated(7, [CrossViewGroup(((0, 0),), np.zeros(2), FIRST[:2, :2])], MOTION, STEPS), np.eye(2, 4)
    for k, z in enumerate(measured):
        if k:
            leaf = predict(leaf, PERIOD, MOTION)
        state, P, seen = leaf.state[0], leaf.covariance[0], np.isfinite(z).all()
        if seen:
            K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
            state, P = state + K @ (z - H @ state), P - K @ H @ P
        states, covariances = leaf.states.copy(), leaf.covariances.copy()
        states[:, 0], covariances[:, 0] = state, P
        misses = np.where(seen, 0, leaf.misses + 1)
        leaf = replace(leaf, state=state[None], covariance=P[None], states=states, covariances=covariances, misses=misses)
    return leaf


@pytest.mark.parametrize("unseen", [(), range(2, 9)])
def test_coasting_tracks_are_smoothed_as_by_the_other_tracker(unseen: Sequence[int]) -> None:
    tracks, measured, R = filtered(np.random.default_rng(0), STEPS, unseen)
    lag = GnnFixedLagSmoother(STEPS - 1, PERIOD, MOTION)
    first = [lag.feed(t, np.ones(1, dtype=bool), hidden) for t in tracks][-1]
    assert first is not None
    ours = smoothed(remembered(measured, R), STEPS - 1, (PERIOD, MOTION))
    np.testing.assert_allclose(ours.state[:, :4], first.state[:, :4], atol=1e-9)
    np.testing.assert_allclose(ours.covariance[:, :4, :4], first.covariance[:, :4, :4], atol=1e-9)
