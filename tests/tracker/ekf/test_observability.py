"""Observability of the joint state: with first estimates, unobservable directions gain no information."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.tracker.ekf.test_state import motion, start
from tracker.ekf.linearization import linearize
from tracker.ekf.measurement_models import predict
from tracker.ekf.state import JointState, LinearizedMeasurement
from tracker.geometry import Pose, tangent_basis
from tracker.geometry.cameras import Panorama
from tracker.types import Mount

Array = NDArray[np.float64]
MOUNT = Mount(Panorama(64, 32), Pose(np.eye(3), np.array([0.1, 0.0, 0.4])), "r")


def team(mode: str) -> tuple[JointState, np.random.Generator]:
    """Two robots, a clone, and four landmarks that are correlated with both."""
    rng = np.random.default_rng(11)
    state = JointState(2, 6, (0.02, 0.02, 0.01), mode)
    for _ in range(2):
        state.add_robot(start(rng, 0.05))
    state.clone(0, 0)
    state.predict(0, motion(rng), 1e-4 * np.eye(6))
    for k in range(4):
        columns = np.concatenate([state.columns(0, np.zeros(0, dtype=np.intp)), state.columns(1, np.zeros(0, dtype=np.intp))])
        state.add_landmark(4 * rng.normal(size=3), columns, rng.normal(size=(3, len(columns))), 0.01 * np.eye(3) * (1 + k))
    return state, rng


def rotation_of_the_world(state: JointState, axis: Array) -> Array:
    """The state's error of a rotation of the whole world about an axis through the origin, over the rows in use."""
    N = np.zeros(len(state.P))
    rotation, translation, point = state.linearization_points
    for p in np.flatnonzero(state.used).tolist():
        at, R = state.offset(p), rotation[p]
        N[at : at + 3], N[at + 3 : at + 6] = R.T @ np.cross(axis, translation[p]), R.T @ axis
    N[state.base :] = np.cross(axis, point[: state.count]).ravel()
    return N[state.active()]


def information_along(state: JointState, direction: Array) -> float:
    """The information of the state along a direction: Nᵀ P⁻¹ N."""
    rows = state.active()
    return float(direction @ np.linalg.solve(state.P[np.ix_(rows, rows)], direction))


def update_by_landmarks(state: JointState, robot: int, rng: np.random.Generator, iterations: int) -> None:
    """An update by three landmarks that are seen some degrees from where they are expected."""
    landmark = np.array([0, 2, 3]) if robot == 0 else np.array([1, 2, 0])
    bearing, _ = predict(state.camera_pose(robot, MOUNT), state.point[landmark])
    bearing = bearing + (0.05 * rng.normal(size=(3, 1, 2)) @ tangent_basis(bearing))[:, 0]
    bearing /= np.linalg.norm(bearing, axis=1, keepdims=True)
    seen = (MOUNT, landmark, bearing, np.tile(0.02**2 * np.eye(2), (3, 1, 1)))

    def system() -> LinearizedMeasurement:
        return linearize(state, robot, seen, None)

    state.update(system, iterations, np.inf)


@pytest.mark.parametrize(("mode", "iterations"), [("fej", 1), ("fej", 2), ("iekf", 1), ("iekf", 2)])
def test_a_rotation_of_the_world_is_unobservable(mode: str, iterations: int) -> None:
    state, rng = team(mode)
    axes = np.eye(3)
    before = [information_along(state, rotation_of_the_world(state, axis)) for axis in axes]
    for k in range(4):
        update_by_landmarks(state, k % 2, rng, iterations)
    after = [information_along(state, rotation_of_the_world(state, axis)) for axis in axes]
    assert np.allclose(after, before, rtol=1e-5) == (mode != "iekf")


def test_first_estimates_keep_the_unobservable_direction_while_robots_move() -> None:
    """Motions without noise leave the information about a rotation of the world unchanged, although updates move the poses in between."""
    state, rng = team("fej")
    before = information_along(state, rotation_of_the_world(state, np.array([0.0, 0.0, 1.0])))
    for k in range(4):
        update_by_landmarks(state, k % 2, rng, 2)
        state.predict(k % 2, motion(rng), np.zeros((6, 6)))
    assert information_along(state, rotation_of_the_world(state, np.array([0.0, 0.0, 1.0]))) == pytest.approx(before, rel=1e-5)


def test_before_the_first_update_first_estimates_are_the_means() -> None:
    """The first update equals the plain one; the reported covariances differ by a rotation of the axes alone."""
    plain, rng = team("iekf")
    first, again = team("fej")
    update_by_landmarks(plain, 0, rng, 1)
    update_by_landmarks(first, 0, again, 1)
    np.testing.assert_allclose(first.translation, plain.translation, atol=1e-12)
    np.testing.assert_allclose(first.point, plain.point, atol=1e-12)
    np.testing.assert_allclose(np.linalg.eigvalsh(first.covariance(0)[:3, :3]), np.linalg.eigvalsh(plain.covariance(0)[:3, :3]), atol=1e-12)
