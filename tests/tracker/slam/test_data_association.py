from __future__ import annotations

import numpy as np

from tracker.ekf.measurement_models import jacobians, predict
from tracker.ekf.state import JointState
from tracker.geometry import Pose, tangent_basis
from tracker.geometry.cameras import Panorama
from tracker.slam.data_association import Gate, associate, innovation_covariance
from tracker.slam.landmark_map import LandmarkMap, PruningParameters, dissimilarity
from tracker.types import Mount, Start

MOUNT = Mount(Panorama(64, 32), Pose(np.eye(3), np.array([0, 0, 0.5])), "r")
POINTS = np.array([[5.0, 0, 1], [0, 4, 0.2], [-6, 1, 2]])


def scene() -> tuple[JointState, np.ndarray]:
    """A robot at the origin, three landmarks, and their exact bearings."""
    joint = JointState(clones=1, capacity=4, correction_sigma=(0.01, 0.01, 0.01))
    joint.add_robot(Start(Pose.identity(), 1e-4 * np.eye(6)))
    rng = np.random.default_rng(0)
    for p in POINTS:
        joint.add_landmark(p, joint.columns(0, np.zeros(0, dtype=np.intp)), 0.5 * rng.normal(size=(3, 9)), 1e-3 * np.eye(3))
    return joint, predict(joint.camera_pose(0, MOUNT), POINTS)[0]


def matches(bearing: np.ndarray, distances: np.ndarray, seen_before: bool = True, rule: Gate | None = None) -> list[tuple[int, int]]:
    joint, _ = scene()
    seen = (bearing, np.tile(1e-6 * np.eye(2), (len(bearing), 1, 1)))
    m = associate(joint, 0, joint.camera_pose(0, MOUNT), seen, (distances.astype(np.float32), np.full(3, seen_before)), rule or Gate())
    return list(zip(m.landmark.tolist(), m.sighting.tolist(), strict=True))


def rotated(bearing: np.ndarray, angle: float) -> np.ndarray:
    return np.cos(angle) * bearing + np.sin(angle) * tangent_basis(bearing)[..., 0, :]


def test_innovation_covariance_is_the_dense_one() -> None:
    joint, _ = scene()
    camera = joint.camera_pose(0, MOUNT)
    body, place, correction = jacobians(camera, POINTS)
    for i, S in enumerate(innovation_covariance(joint, 0, camera, np.arange(joint.count))):
        H = np.zeros((2, len(joint.P)))
        H[:, :6], H[:, 6:9], H[:, joint.base + 3 * i : joint.base + 3 * i + 3] = body[i], correction[i], place[i]
        np.testing.assert_allclose(S, H @ joint.P @ H.T, atol=1e-14)


def test_a_similar_sighting_outside_the_gate_is_rejected() -> None:
    joint, b = scene()
    outside = rotated(b[:1], 0.14)
    appearance = (np.array([[0.1], [1.0], [1.0]], dtype=np.float32), np.ones(3, dtype=bool))
    m = associate(joint, 0, joint.camera_pose(0, MOUNT), (outside, 1e-6 * np.eye(2)[None]), appearance, Gate(probability=0.5))
    assert len(m.landmark) == 0
    assert m.rejected.tolist() == [0]


def test_an_ambiguous_sighting_fails_the_ratio_test() -> None:
    _, b = scene()
    both = np.concatenate([b[:1], rotated(b[:1], 0.03)])
    assert matches(both, np.array([[0.30, 0.31], [1, 1], [1, 1]])) == []
    assert matches(both, np.array([[0.1, 0.5], [1, 1], [1, 1]])) == [(0, 0)]


def test_a_new_view_needs_a_smaller_distance() -> None:
    _, b = scene()
    distances = np.where(np.eye(3, dtype=bool), 0.5, 1.2)
    assert len(matches(b, distances, seen_before=True)) == 3
    assert matches(b, distances, seen_before=False) == []


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
