from __future__ import annotations

import numpy as np
import pytest

from tests.tracker.kalman import condition
from tracker.ekf.measurement_models import gravity, residual
from tracker.ekf.state import JointState, LinearizedMeasurement
from tracker.geometry import Pose, skew
from tracker.types import Start


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(2)


def start(rng: np.random.Generator, sigma: float = 0.1) -> Start:
    A = rng.normal(size=(6, 6)) * sigma
    return Start(Pose.exp(rng.normal(size=6)), A @ A.T + sigma**2 * np.eye(6))


def motion(rng: np.random.Generator) -> Pose:
    return Pose.exp(0.3 * rng.normal(size=6))


Sigma = tuple[float, float, float] | None


def joint(rng: np.random.Generator, robots: int = 2, correction: Sigma = (0.02, 0.02, 0.01)) -> JointState:
    state = JointState(clones=2, capacity=6, correction_sigma=correction)
    for _ in range(robots):
        state.add_robot(start(rng))
    return state


def state_with_map(rng: np.random.Generator, correction: Sigma = (0.02, 0.02, 0.01)) -> JointState:
    state = joint(rng, correction=correction)
    state.clone(0, 1)
    state.predict(0, motion(rng), 1e-4 * np.eye(6))
    for robot in (0, 1, 0):
        columns = state.columns(robot, np.zeros(0, dtype=np.intp))
        state.add_landmark(rng.normal(size=3), columns, rng.normal(size=(3, len(columns))), 0.01 * np.eye(3))
    return state


def active(state: JointState) -> np.ndarray:
    rows = state.active()
    return state.P[np.ix_(rows, rows)]


def test_a_clone_is_the_robot_until_it_moves(rng: np.random.Generator) -> None:
    state = joint(rng)
    slot = state.clone(1, 0)
    a, b = state.offset(1), state.offset(slot)
    difference = np.zeros((6, len(state.P)))
    difference[range(6), range(a, a + 6)], difference[range(6), range(b, b + 6)] = 1, -1
    np.testing.assert_allclose(difference @ state.P @ difference.T, 0, atol=1e-15)
    M = motion(rng)
    state.predict(1, M, 1e-4 * np.eye(6))
    F = np.block([[M.rotation.T, -M.rotation.T @ skew(M.translation)], [np.zeros((3, 3)), M.rotation.T]])
    np.testing.assert_allclose(state.P[a : a + 6, b : b + 6], F @ state.P[b : b + 6, b : b + 6], atol=1e-12)


def test_a_new_robot_is_uncorrelated_and_may_join_late(rng: np.random.Generator) -> None:
    state = state_with_map(rng)
    before, poses = active(state), state.translation[state.used].copy()
    late = start(rng)
    robot = state.add_robot(late)
    after = active(state)
    new = np.arange(2 * state.stride, 3 * state.stride)
    old = np.setdiff1d(np.arange(len(after)), new)
    np.testing.assert_array_equal(after[np.ix_(old, old)], before)
    np.testing.assert_array_equal(after[np.ix_(new[:6], new[:6])], late.covariance)
    assert not after[np.ix_(old, new)].any()
    np.testing.assert_array_equal(state.translation[robot], late.T_world_robot.translation)
    np.testing.assert_array_equal(np.delete(state.translation[state.used], robot, axis=0), poses)


def test_a_new_landmark_is_a_linear_map_of_the_state(rng: np.random.Generator) -> None:
    state = state_with_map(rng)
    columns, P = state.columns(1, np.array([0])), state.P.copy()
    G, own = rng.normal(size=(3, len(columns))), np.diag([1.0, 2.0, 3.0])
    wide = np.zeros((3, len(P)))
    wide[:, columns] = G
    state.add_landmark(np.zeros(3), columns, G, own)
    np.testing.assert_allclose(state.P[-3:, :-3], wide @ P, atol=1e-12)
    np.testing.assert_allclose(state.P[-3:, -3:], wide @ P @ wide.T + own, atol=1e-12)


def test_removal_marginalises_and_renumbers(rng: np.random.Generator) -> None:
    state = state_with_map(rng)
    P, points = state.P.copy(), state.point[:3].copy()
    state.remove_landmark(0)
    b = state.base
    kept = np.concatenate([np.arange(b), b + 6 + np.arange(3), b + 3 + np.arange(3)])
    np.testing.assert_array_equal(state.P, P[np.ix_(kept, kept)])
    np.testing.assert_array_equal(state.point[:2], points[[2, 1]])


@pytest.mark.parametrize("correction", [None, (0.02, 0.02, 0.01)])
def test_one_iteration_is_the_plain_ekf_update(rng: np.random.Generator, correction: Sigma) -> None:
    state = state_with_map(rng, correction)
    columns = state.columns(0, np.array([2, 0]))
    H, r, noise = rng.normal(size=(4, len(columns))), 1e-4 * rng.normal(size=4), np.tile(1e-2 * np.eye(2), (2, 1, 1))
    wide = np.zeros((4, len(state.P)))
    wide[:, columns] = H
    change, P = condition(state.P, wide, r, 1e-2 * np.eye(4))
    point, translation, R = state.point[:3].copy(), state.translation[1].copy(), state.rotation[1].copy()
    state.update(lambda: LinearizedMeasurement(columns, H, r, noise), 1, np.inf)
    np.testing.assert_allclose(state.P, P, atol=1e-3)  # The reset moves the tangents by as little as the mean has moved.
    np.testing.assert_allclose(state.point[:3], point + change[state.base :].reshape(-1, 3), atol=1e-12)
    at = state.offset(1)
    np.testing.assert_allclose(state.translation[1], translation + R @ change[at : at + 3], atol=1e-12)


def test_an_iterated_update_minimises_the_squares_of_a_nonlinear_measurement() -> None:
    """After many iterations the gradient of prior and measurement together vanishes at the mean (Bell & Cathey 1993)."""
    rng = np.random.default_rng(4)
    state = JointState(clones=1, capacity=1, correction_sigma=None)
    prior = start(rng, 0.3)
    state.add_robot(prior)
    up = Pose.exp(np.array([0, 0, 0, 0.5, -0.4, 0.1])).rotation[2]
    noise = np.tile(0.05 * np.eye(2), (1, 1, 1))

    def linearize() -> LinearizedMeasurement:
        r, H = gravity(state.rotation[0], up)
        return LinearizedMeasurement(np.arange(6), H, r, noise)

    state.update(linearize, 30, np.inf)
    found = (prior.T_world_robot.inverse() @ Pose(state.rotation[0], state.translation[0])).log()

    def cost(xi: np.ndarray) -> float:
        r = residual(up, (prior.T_world_robot @ Pose.exp(xi)).rotation[2])
        return float(xi @ np.linalg.solve(prior.covariance, xi) + r @ r / 0.05)

    gradient = [(cost(found + d) - cost(found - d)) / 2e-5 for d in np.eye(6) * 1e-5]
    start_gradient = [(cost(d) - cost(-d)) / 2e-5 for d in np.eye(6) * 1e-5]
    assert np.linalg.norm(gradient) < 2e-2 * np.linalg.norm(start_gradient)
    assert np.linalg.eigvalsh(active(state)).min() > 0
