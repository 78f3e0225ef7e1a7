"""Checks of the values that the tracker takes: invalid ones are refused."""

from __future__ import annotations

import numpy as np
import pytest

from tracker.geometry import Pose
from tracker.geometry.cameras import Panorama
from tracker.geometry.ground import Flat
from tracker.types import Mount, Odometry, RobotDetections, Setup, Sightings, Start


def sightings(covariance: object, reach: float = np.nan) -> Sightings:
    return Sightings(np.array([[1.0, 0, 0]]), np.array([reach]), np.array([-1]), np.zeros((1, 2)), np.array([covariance]))


@pytest.mark.parametrize(
    "covariance", [np.zeros((2, 2)), [[1e-4, 2e-4], [2e-4, 1e-4]], [[-1e-4, 0], [0, -1e-4]], [[1, 0.5], [0.2, 1]], [[np.inf, 0], [0, 1]]]
)
def test_covariance_of_sightings_must_be_positive(covariance: object) -> None:
    with pytest.raises(ValueError, match=r"covariance of sighting 0 is \[\[.*needs a symmetric positive matrix"):
        sightings(covariance)


@pytest.mark.parametrize("reach", [0.0, -1.0])
def test_range_of_sightings_must_be_positive(reach: float) -> None:
    with pytest.raises(ValueError, match=f"sighting range is {reach:g} m, needs more than 0"):
        sightings(np.eye(2), reach)
    assert len(sightings(np.eye(2), 2.0)) == len(sightings(np.eye(2))) == 1


def test_covariance_of_poses_must_not_be_negative() -> None:
    bad = np.diag([1e-4, 1, 1, 1, 1, -1e-4])
    with pytest.raises(ValueError, match=r"covariance of odometry has an eigenvalue of -0.0001, needs at least 0"):
        Odometry(Pose.identity(), bad)
    with pytest.raises(ValueError, match=r"covariance of start has an eigenvalue of -0.0001, needs at least 0"):
        Start(Pose.identity(), bad)
    with pytest.raises(ValueError, match="covariance of start is not finite and symmetric"):
        Start(Pose.identity(), np.eye(6) + np.triu(np.ones((6, 6)), 1))
    assert not Start(Pose.identity(), np.zeros((6, 6))).covariance.any(), "what is known exactly is allowed"


@pytest.mark.parametrize(("up", "sigma"), [([0, 0, 0], 0.02), ([0, 0, 1], 0.0)])
def test_gravity_must_be_a_direction(up: list[float], sigma: float) -> None:
    with pytest.raises(ValueError, match="needs a direction and more than 0"):
        Odometry(Pose.identity(), np.eye(6), np.array(up, dtype=np.float64), sigma)


def test_robot_detections_are_directions_of_different_robots() -> None:
    ahead, sure = np.array([[1.0, 0, 0], [0, 1, 0]]), np.tile(1e-4 * np.eye(2), (2, 1, 1))
    assert RobotDetections(ahead, ("a", "b"), sure).robot == ("a", "b")
    with pytest.raises(ValueError, match="detected robots are a, a, needs each robot once"):
        RobotDetections(ahead, ("a", "a"), sure)
    with pytest.raises(ValueError, match="robot bearing has length 2, needs 1"):
        RobotDetections(2 * ahead, ("a", "b"), sure)
    with pytest.raises(ValueError, match=r"robot bearing has length 0\.5, needs 1"):
        RobotDetections(0.5 * ahead, ("a", "b"), sure)
    with pytest.raises(ValueError, match="covariance of robot detection 0 is"):
        RobotDetections(ahead, ("a", "b"), 0 * sure)
    with pytest.raises(ValueError, match=r"bearing has shape \(2, 3\)"):
        RobotDetections(ahead, ("a",), sure)


EXACT, DOUBTED = Start(Pose.identity(), np.zeros((6, 6))), Start(Pose.identity(), 1e-4 * np.eye(6))


def setup_of(starts: dict[str, Start | None], area: np.ndarray | None = None) -> Setup:
    return Setup({name: Mount(Panorama(64, 32), Pose.identity(), name) for name in starts}, Flat(), starts, 0.1, area=area)


def test_area_includes_its_edge() -> None:
    setup = setup_of({"a": EXACT}, np.array([[-1.0, 2.0], [3.0, 4.0]]))
    points = np.array([[0.0, 3.0], [-1.0, 2.0], [3.0, 4.0], [3.5, 3.0], [0.0, 1.75], [-2.0, 6.5], [np.nan, 3.0]])
    inside = [True, True, True, False, False, False, False]
    assert setup.contains(points).tolist() == inside
    np.testing.assert_array_equal(setup.distance_beyond(points), [0, 0, 0, 0.5, 0.25, 2.5, np.nan])
    high = np.column_stack([points, np.full(len(points), 99.0)])
    assert setup.contains(high).tolist() == inside, "height does not matter"
    assert setup.contains(points[:0]).shape == setup.distance_beyond(points[:0]).shape == (0,)


def test_setup_without_area_contains_all_points() -> None:
    setup, far = setup_of({"a": EXACT}), np.array([[1e6, 0.0], [0.0, -1e6]])
    assert setup.contains(far).all()
    assert not setup.distance_beyond(far).any()


def test_a_fixed_camera_has_a_start_pose_without_covariance() -> None:
    setup = setup_of({"wanderer": DOUBTED, "camera": EXACT, "lost": None, "rover": DOUBTED})
    assert [name for name in setup.starts if setup.is_fixed(name)] == ["camera"]
    assert setup.moving_robots == ("wanderer", "lost", "rover")
    assert setup.anchored_robots == ("wanderer", "rover")
