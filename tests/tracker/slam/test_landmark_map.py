from __future__ import annotations

import numpy as np
import pytest

from tracker.slam.landmark_map import LandmarkMap, PruningParameters, dissimilarity, spread, unit_rows


def look(*angles: float) -> np.ndarray:
    return np.stack([np.cos(angles), np.sin(angles)], axis=1).astype(np.float32)


def ids(*numbers: int) -> np.ndarray:
    return np.array(numbers, dtype=np.intp)


def book() -> LandmarkMap:
    marks = LandmarkMap(capacity=5, robots=2)
    for i, angle in enumerate((0.0, 1.0, 2.0)):
        marks.add(-1, look(angle)[0], robot=i % 2, tick=i, hits=4)
    return marks


def test_the_best_look_counts_and_empty_ones_do_not() -> None:
    looks = np.stack([np.stack([look(0.0)[0], look(1.0)[0]]), np.stack([look(2.0)[0], np.zeros(2, dtype=np.float32)])])
    d = dissimilarity(looks, ids(-1, -1), look(1.0, 2.1), ids(-1, -1))
    # The chord of an angle a is 2 sin(a/2).
    np.testing.assert_allclose(d, [[0, 2 * np.sin(0.55)], [2 * np.sin(0.5), 2 * np.sin(0.05)]], atol=1e-3)


def test_names_decide_alone() -> None:
    d = dissimilarity(look(0.0, 0.0)[:, None], ids(7, -1), look(3.0, 0.0, 0.0), ids(7, 8, -1))
    np.testing.assert_allclose(d, [[0, np.inf, np.inf], [np.inf, np.inf, 0]], atol=1e-3)


def test_unit_rows_of_any_scale() -> None:
    np.testing.assert_allclose(unit_rows([[3, 4], [0, 0], [0, 512]]), [[0.6, 0.8], [0, 0], [0, 1]], atol=1e-7)
    with pytest.raises(ValueError, match="needs"):
        unit_rows([1.0, 2.0])


def test_removal_puts_the_last_in_the_place() -> None:
    marks = book()
    marks.remove(0)
    assert marks.count == 2
    np.testing.assert_array_equal(marks.identity[:2], [2, 1])
    np.testing.assert_allclose(marks.look[0, 0], look(2.0)[0])
    marks.add(-1, look(0.5)[0], 0, 9, 1)
    assert marks.identity[2] == 3, "a number is never used again"


def test_a_landmark_goes_by_trial_or_by_refusals() -> None:
    marks, rule = book(), PruningParameters(young=4, trial=3, refusals=2)
    marks.hits[:3], marks.missed[:3], marks.refused[:3] = [3, 9, 9], [3, 50, 0], [0, 0, 2]
    np.testing.assert_array_equal(marks.doomed(rule), [0, 2])
    marks.seen(ids(0, 2), look(0.0, 2.0), robot=1, tick=8)
    assert len(marks.doomed(rule)) == 0
    assert marks.stalest() == 1


def test_what_a_blind_robot_knows_does_not_grow_stale() -> None:
    marks = book()
    marks.seen(ids(0, 1), look(0.0, 1.0), robot=0, tick=20)
    marks.seen(ids(2), look(2.0), robot=1, tick=5)
    marks.looked[:] = [22, 22]
    assert marks.stalest() == 2
    marks.looked[1] = 5
    assert marks.stalest() in (0, 1)


def test_descriptors_keep_their_length() -> None:
    with pytest.raises(ValueError, match="length 3"):
        book().add(-1, np.ones(3, dtype=np.float32), 0, 0, 1)


def test_spread_takes_from_all_sides_first() -> None:
    azimuth = np.concatenate([np.full(10, 0.1), [1.5, -2.0]])
    chosen = spread(azimuth, np.arange(12.0)[::-1], 4)
    np.testing.assert_array_equal(chosen, [0, 1, 10, 11])
    assert len(spread(azimuth, np.zeros(12), 50)) == 12
