from __future__ import annotations

import numpy as np

from tracker.ekf.measurement_models import jacobians, predict
from tracker.ekf.state import JointState
from tracker.geometry import Pose, tangent_basis
from tracker.geometry.cameras import Panorama
from tracker.slam.data_association import Gate, associate, innovation_covariance
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


def test_matches_do_not_depend_on_the_order() -> None:
    _, b = scene()
    distances = np.where(np.eye(3, dtype=bool), 0.1, 1.2)
    assert matches(b, distances) == [(0, 0), (1, 1), (2, 2)]
    assert matches(b[::-1], distances[:, ::-1]) == [(0, 2), (1, 1), (2, 0)]


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
