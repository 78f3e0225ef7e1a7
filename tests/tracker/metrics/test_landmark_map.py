"""Scores of maps."""

from __future__ import annotations

import numpy as np
from numpy.testing import assert_allclose

from tracker.geometry import Pose
from tracker.metrics.landmark_map import NEAR, score_map

TRUTH = np.array([[0.0, 0, 0], [3, 0, 0], [0, 3, 0], [3, 3, 1]])


def test_by_hand() -> None:
    # Two landmarks are 0.3 m off, one is exact, a copy of it and one in the middle of nowhere are ghosts; the fourth true one is not there.
    landmarks = np.array([[0.3, 0, 0], [3, 0.3, 0], [0, 3, 0], [0, 3, 0.1], [1.5, 1.5, 0]])
    d = score_map(TRUTH, landmarks, np.ones(4, dtype=bool))
    assert_allclose([d["map_m"], d["map_aligned_m"], d["map_complete"], d["map_ghosts"]], [np.sqrt(0.06)] * 2 + [0.75, 0.4])
    few = score_map(TRUTH, landmarks, np.array([True, False, False, True]))
    assert few["map_complete"] == 0.5


def test_the_map_is_moved_with_the_team() -> None:
    T = Pose.exp([2, -1, 0.5, 0.1, 0.2, 1.0])
    d = score_map(TRUTH, T.apply(TRUTH), np.ones(4, dtype=bool), T.inverse())
    assert_allclose(d["map_aligned_m"], 0, atol=1e-9)
    assert (d["map_complete"], d["map_ghosts"]) == (1, 0)
    assert d["map_m"] is not None
    assert d["map_m"] > NEAR
    assert score_map(TRUTH, T.apply(TRUTH), np.ones(4, dtype=bool))["map_complete"] != 1


def test_nothing_is_undefined() -> None:
    none, all_ = score_map(TRUTH, np.zeros((0, 3)), np.ones(4, dtype=bool)), score_map(np.zeros((0, 3)), TRUTH, np.ones(0, dtype=bool))
    assert list(none.values()) == [None, None, 0.0, None]
    assert list(all_.values()) == [None, None, None, 1.0]
