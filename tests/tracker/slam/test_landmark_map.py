from __future__ import annotations

import numpy as np
import pytest

from tracker.slam.landmark_map import LandmarkMap, PruningParameters, dissimilarity, spread_over_azimuth, unit_rows


def unit_descriptor(*angles: float) -> np.ndarray:
    return np.stack([np.cos(angles), np.sin(angles)], axis=1).astype(np.float32)


def ids(*numbers: int) -> np.ndarray:
    return np.array(numbers, dtype=np.intp)


def landmark_map() -> LandmarkMap:
    landmarks = LandmarkMap(capacity=5, robots=2)
    for i, angle in enumerate((0.0, 1.0, 2.0)):
        landmarks.add(-1, unit_descriptor(angle)[0], robot=i % 2, tick=i, hits=4)
    return landmarks


def test_the_nearest_of_several_descriptors_counts() -> None:
    descriptors = np.stack(
        [np.stack([unit_descriptor(0.0)[0], unit_descriptor(1.0)[0]]), np.stack([unit_descriptor(2.0)[0], np.zeros(2, dtype=np.float32)])]
    )
    d = dissimilarity(descriptors, ids(-1, -1), unit_descriptor(1.0, 2.1), ids(-1, -1))
    # The chord of an angle a is 2 sin(a/2).
    np.testing.assert_allclose(d, [[0, 2 * np.sin(0.55)], [2 * np.sin(0.5), 2 * np.sin(0.05)]], atol=1e-3)


def test_known_subjects_decide_alone() -> None:
    d = dissimilarity(unit_descriptor(0.0, 0.0)[:, None], ids(7, -1), unit_descriptor(3.0, 0.0, 0.0), ids(7, 8, -1))
    np.testing.assert_allclose(d, [[0, np.inf, np.inf], [np.inf, np.inf, 0]], atol=1e-3)


def test_unit_rows_of_any_scale() -> None:
    np.testing.assert_allclose(unit_rows([[3, 4], [0, 0], [0, 512]]), [[0.6, 0.8], [0, 0], [0, 1]], atol=1e-7)
    with pytest.raises(ValueError, match="needs"):
        unit_rows([1.0, 2.0])


def test_the_last_landmark_replaces_a_removed_one() -> None:
    landmarks = landmark_map()
    landmarks.remove(0)
    assert landmarks.count == 2
    np.testing.assert_array_equal(landmarks.identity[:2], [2, 1])
    np.testing.assert_allclose(landmarks.descriptor[0, 0], unit_descriptor(2.0)[0])
    landmarks.add(-1, unit_descriptor(0.5)[0], 0, 9, 1)
    assert landmarks.identity[2] == 3, "numbers are never reused"


def test_landmarks_are_pruned_by_misses_or_rejections() -> None:
    landmarks, parameters = landmark_map(), PruningParameters(min_sightings=4, max_misses=3, max_rejections=2)
    landmarks.hits[:3], landmarks.missed[:3], landmarks.rejected[:3] = [3, 9, 9], [3, 50, 0], [0, 0, 2]
    np.testing.assert_array_equal(landmarks.to_prune(parameters), [0, 2])
    landmarks.record_sightings(ids(0, 2), unit_descriptor(0.0, 2.0), robot=1, tick=8)
    assert len(landmarks.to_prune(parameters)) == 0
    assert landmarks.least_recently_seen() == 1


def test_landmarks_of_a_blind_robot_are_kept() -> None:
    landmarks = landmark_map()
    landmarks.record_sightings(ids(0, 1), unit_descriptor(0.0, 1.0), robot=0, tick=20)
    landmarks.record_sightings(ids(2), unit_descriptor(2.0), robot=1, tick=5)
    landmarks.last_localized[:] = [22, 22]
    assert landmarks.least_recently_seen() == 2
    landmarks.last_localized[1] = 5
    assert landmarks.least_recently_seen() in (0, 1)


def test_descriptors_keep_their_length() -> None:
    with pytest.raises(ValueError, match="length 3"):
        landmark_map().add(-1, np.ones(3, dtype=np.float32), 0, 0, 1)


def test_items_are_spread_over_all_sectors() -> None:
    azimuth = np.concatenate([np.full(10, 0.1), [1.5, -2.0]])
    chosen = spread_over_azimuth(azimuth, np.arange(12.0)[::-1], 4)
    np.testing.assert_array_equal(chosen, [0, 1, 10, 11])
    assert len(spread_over_azimuth(azimuth, np.zeros(12), 50)) == 12
