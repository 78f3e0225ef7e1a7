from __future__ import annotations

import numpy as np
import pytest

from tracker.ekf.state import JointState
from tracker.geometry import Pose, tangent_basis
from tracker.geometry.cameras import Panorama
from tracker.geometry.ground import Flat
from tracker.slam.landmark_initialization import FeatureTracks, InitializationParameters, LandmarkInitializer
from tracker.slam.landmark_map import LandmarkMap
from tracker.types import Mount, Sightings, Start

MOUNT = Mount(Panorama(64, 32), Pose(np.eye(3), np.array([0, 0, 0.5])), "r")
SIGMA = 0.001


def drive(
    points: np.ndarray,
    step: float,
    sigma: float = 0.0,
    seed: int = 0,
    parameters: InitializationParameters | None = None,
    velocity: float = 0.0,
    *,
    ticks: int = 10,
    spacing: int = 2,
    named: bool = True,
    clones: int = 1,
) -> tuple[JointState, LandmarkInitializer]:
    """A robot along x, a clone at every `spacing`-th tick; the points may move along y by `velocity` m a tick."""
    rng = np.random.default_rng(seed)
    joint, landmark_map = JointState(clones=4, capacity=10, correction_sigma=None), LandmarkMap(10, 1)
    joint.add_robot(Start(Pose.identity(), 1e-12 * np.eye(6)))
    initializer = LandmarkInitializer(0, MOUNT, (joint, landmark_map), Flat(0.0), parameters or InitializationParameters())
    for k in range(ticks):
        if k:
            joint.predict(0, Pose(np.eye(3), np.array([step, 0, 0])), 1e-14 * np.eye(6))
        p = points + np.array([-step * k, velocity * k, -0.5])
        b = p / np.linalg.norm(p, axis=1, keepdims=True)
        b = b + (sigma * rng.normal(size=(len(b), 1, 2)) @ tangent_basis(b))[:, 0]
        b /= np.linalg.norm(b, axis=1, keepdims=True)
        n = len(points)
        subject, descriptor = np.where(named, np.arange(n), -1), np.eye(n, 4, dtype=np.float32) * (not named)
        seen = Sightings(b, np.full(n, np.nan), subject, descriptor, np.tile(np.eye(2) * SIGMA**2, (n, 1, 1)))
        known = landmark_map.subject[: landmark_map.count]
        initializer.advance(seen, np.flatnonzero((subject < 0) | ~np.isin(subject, known)), 10, k, clones)
        if k % spacing == 0:
            joint.clone(0, (k // spacing) % 4)
            initializer.record_clone((k // spacing) % 4)
    return joint, initializer


def test_points_are_triangulated_once_the_rays_cross() -> None:
    points = np.array([[3.0, 2, 1], [-2, 4, 0.5], [1, -3, 2]])
    joint, initializer = drive(points, 0.12)
    assert initializer.counters["new"] == 3
    order = np.argsort(initializer.landmark_map.subject[:3])
    np.testing.assert_allclose(joint.point[:3][order], points, atol=0.02)
    assert len(initializer.tracks) == 0


def test_without_a_baseline_nothing_is_triangulated() -> None:
    joint, initializer = drive(np.array([[3.0, 2, 1]]), 0.0)
    assert joint.count == 0
    assert initializer.counters["little parallax"] > 0


@pytest.mark.parametrize(("point", "reason"), [((2.0, 3.0, -1.0), "below ground"), ((1.0, 5.0, 0.6), "out of range")])
def test_rejections_have_reasons(point: tuple[float, float, float], reason: str) -> None:
    joint, initializer = drive(np.array([point]), 0.15, parameters=InitializationParameters(max_range=4.0))
    assert joint.count == 0
    assert initializer.counters[reason] > 0


def test_a_moving_point_is_not_triangulated() -> None:
    """It moves across the line of sight of a passing robot: the bearings of three ticks are inconsistent."""
    joint, initializer = drive(np.array([[1.0, 2, 1]]), 0.12, velocity=-0.15)
    assert joint.count == 0 or initializer.counters["rays disagree"] > 0


def test_a_feature_that_moves_along_its_epipolar_line_needs_two_clones() -> None:
    """The point moves at the height of the camera. One clone and the present pose do not contradict it, two clones do."""
    point = np.array([[1.0, 2, 0.5]])
    for clones, landmarks in ((1, 1), (2, 0)):
        joint, _ = drive(point, 0.12, velocity=-0.1, ticks=5, spacing=4, named=False, clones=clones)
        assert joint.count == landmarks
    joint, initializer = drive(point, 0.12, velocity=-0.1, spacing=4, named=False, clones=2)
    assert joint.count == 0
    assert initializer.counters["rays disagree"] > 0


def test_the_new_covariance_is_consistent() -> None:
    errors = []
    for seed in range(60):
        joint, initializer = drive(np.array([[1.5, 3, 1]]), 0.1, SIGMA, seed)
        assert initializer.counters["new"] == 1
        e = joint.point[0] - [1.5, 3, 1]
        errors.append(e @ np.linalg.solve(joint.P[-3:, -3:], e) / 3)
    assert 0.5 < np.mean(errors) < 1.6


def tracks(directions: np.ndarray) -> FeatureTracks:
    c, n = FeatureTracks(2), len(directions)
    c.initiate(0, np.zeros(3), (directions, directions, np.tile(np.eye(2), (n, 1, 1))), (np.eye(n, dtype=np.float32), np.full(n, -1)))
    return c


def test_feature_tracks_are_searched_along_their_epipolar_segment() -> None:
    c, appearance = tracks(np.array([[0.0, 1, 0]])), (np.ones((1, 1), dtype=np.float32), np.array([-1]))
    origin = np.array([0.1, 0, 0])
    for point, found in (([0, 2, 0], True), ([0, 50, 0], True), ([0.2, 2, 0], False), ([0, 2, 0.2], False), ([0, -2, 0], False)):
        d = (np.array(point) - origin)[None]
        c = tracks(np.array([[0.0, 1, 0]]))
        assert (c.track(origin, d / np.linalg.norm(d), appearance, InitializationParameters())[0] >= 0) == found, point


def test_a_tick_without_sightings_is_a_miss() -> None:
    """Feature tracks survive an empty image, and the next tick may match them again."""
    _, initializer = drive(np.array([[3.0, 2, 1]]), 0.0)
    tracks = len(initializer.tracks)
    assert tracks
    nothing = Sightings(np.zeros((0, 3)), np.zeros(0), np.zeros(0, dtype=np.int64), np.zeros((0, 4), dtype=np.float32), np.zeros((0, 2, 2)))
    initializer.advance(nothing, np.zeros(0, dtype=np.int64), 10, 10)
    initializer.record_clone(1)
    assert len(initializer.tracks) == tracks


def test_noisy_bearings_need_more_parallax() -> None:
    rule = InitializationParameters()
    sharp, blunt = (rule.scaled_to_noise(np.tile(np.eye(2) * np.deg2rad(noise) ** 2, (5, 1, 1))) for noise in (0.12, 0.5))
    assert sharp == rule == rule.scaled_to_noise(np.zeros((0, 2, 2)))
    assert 2 * rule.min_parallax < blunt.min_parallax < 3 * rule.min_parallax
    assert 2 * rule.epipolar_tolerance < blunt.epipolar_tolerance < 3 * rule.epipolar_tolerance
