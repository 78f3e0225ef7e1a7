"""The planar filter: Jacobians against differences, the textbook's update, observability, and numerical stability."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from tracker.planar_slam.event_schedule import PlanarParameters, initial_state, run_filter
from tracker.planar_slam.filter import (
    ROBOT,
    SCAN,
    STEP,
    EventSchedule,
    FilterSettings,
    PlanarState,
    Scan,
    invert_measurement,
    linearize,
    predict,
    process_scan,
    update,
)

Array = NDArray[np.float64]
ROBOTS, LANDMARKS = 2, 3


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(5)


def team(rng: np.random.Generator, known: bool = True) -> PlanarState:
    """Two robots and three landmarks, all correlated."""
    start = np.zeros((ROBOTS, ROBOT))
    start[:, :3] = [[0.3, -0.2, 0.4], [2.5, 1.0, -2.0]]
    start[:, 3:] = 0.02 * rng.normal(size=(ROBOTS, ROBOT - 3))
    s = initial_state(start, np.tile(0.01 * np.eye(ROBOT), (ROBOTS, 1, 1)), LANDMARKS)
    if known:
        s.mean[ROBOT * ROBOTS :] = s.first[ROBOT * ROBOTS :] = [3.0, 2.0, -2.0, 3.0, 1.0, -4.0]
        A = 0.1 * rng.normal(size=s.P.shape)
        s.P[:] = A @ A.T + 1e-3 * np.eye(len(A))
        s.initialized[:] = True
    return s


def settings(mode: str, iterations: int = 1, robust: float = np.inf, curvature: float = 0.0, max_outlier_excess: int = 1000) -> FilterSettings:
    return PlanarParameters(mode, iterations, robust=robust, curvature=curvature, max_outlier_excess=max_outlier_excess).settings()


def copy(s: PlanarState) -> PlanarState:
    return PlanarState(*(part.copy() for part in s))


def exact(s: PlanarState, robot: int, subject: int) -> Array:
    """The measurement of a robot without noise if the mean were the truth."""
    H = np.zeros((2, len(s.mean)))
    to = ROBOT * subject if subject < ROBOTS else ROBOT * ROBOTS + 2 * (subject - ROBOTS)
    r = linearize(s, (False, ROBOT * robot, to), np.zeros(2), H)
    return np.array([-r[0], (-r[1] + np.pi) % (2 * np.pi) - np.pi])


@pytest.mark.parametrize("subject", [1, 3])
def test_jacobians_of_a_measurement_against_differences(rng: np.random.Generator, subject: int) -> None:
    s = team(rng)
    H, step = np.zeros((2, len(s.mean))), 1e-6
    to = ROBOT * subject if subject < ROBOTS else ROBOT * ROBOTS + 2 * (subject - ROBOTS)
    linearize(s, (False, 0, to), np.zeros(2), H)
    for k in range(len(s.mean)):
        up, down = copy(s), copy(s)
        up.mean[k] += step
        down.mean[k] -= step
        np.testing.assert_allclose(H[:, k], (exact(up, 0, subject) - exact(down, 0, subject)) / (2 * step), atol=1e-7)


def test_the_predicted_covariance_against_differences(rng: np.random.Generator) -> None:
    s, motion, noise, step = team(rng), np.array([0.2, 0.01]), np.zeros(ROBOT), 1e-6
    F = np.zeros_like(s.P)
    for k in range(len(s.mean)):
        up, down = copy(s), copy(s)
        up.mean[k] += step
        down.mean[k] -= step
        predict(up, False, ROBOT, motion, noise)
        predict(down, False, ROBOT, motion, noise)
        F[:, k] = (up.mean - down.mean) / (2 * step)
    P = F @ s.P @ F.T
    predict(s, False, ROBOT, motion, noise)
    np.testing.assert_allclose(s.P, P, atol=1e-5)


def test_the_inverse_model_and_its_jacobians_against_differences(rng: np.random.Generator) -> None:
    s, z, sigma, step = team(rng), np.array([3.0, 0.7]), np.array([0.1, 0.02]), 1e-6
    to = ROBOT * ROBOTS
    G, own = invert_measurement(s, (False, 0, to), z, sigma)
    np.testing.assert_allclose(exact(s, 0, ROBOTS), z, atol=1e-12)

    def at(change: Array) -> Array:
        t = copy(s)
        t.mean[:6] += change[:6]
        invert_measurement(t, (False, 0, to), z + change[6:], sigma)
        return t.mean[to : to + 2]

    D = np.array([(at(d) - at(-d)) / (2 * step) for d in step * np.eye(8)]).T
    np.testing.assert_allclose(G, D[:, :6], atol=1e-6)
    np.testing.assert_allclose(own, D[:, 6:] @ np.diag(sigma**2) @ D[:, 6:].T, atol=1e-6)


@pytest.mark.parametrize("mode", ["ekf", "fej"])
def test_one_iteration_is_the_textbooks_update(rng: np.random.Generator, mode: str) -> None:
    s = team(rng)
    z = np.array([exact(s, 0, 2), exact(s, 0, 1)])
    z += [[0.1, -0.02], [-0.05, 0.03]]
    sigma = np.array([[0.1, 0.02], [0.2, 0.03]])
    H, r = np.zeros((4, len(s.mean))), np.zeros(4)
    r[:2], r[2:] = linearize(s, (False, 0, ROBOT * ROBOTS), z[0], H[:2]), linearize(s, (False, 0, ROBOT), z[1], H[2:])
    R = np.diag(sigma.ravel() ** 2)
    K = s.P @ H.T @ np.linalg.inv(H @ s.P @ H.T + R)
    mean, I_KH = s.mean + K @ r, np.eye(len(s.mean)) - K @ H
    P = I_KH @ s.P @ I_KH.T + K @ R @ K.T
    update(s, settings(mode), 0, Scan(np.array([2, 1]), z, sigma))
    np.testing.assert_allclose(s.mean, mean, atol=1e-12)
    np.testing.assert_allclose(s.P, P, atol=1e-12)


def rotation_of_the_world(s: PlanarState) -> Array:
    """The direction in which all positions and headings rotate about the origin together."""
    N = np.zeros(len(s.mean))
    team_end = ROBOT * ROBOTS
    for at in [*range(0, team_end, ROBOT), *range(team_end, len(N), 2)]:
        N[at], N[at + 1] = -s.mean[at + 1], s.mean[at]
    N[2:team_end:ROBOT] = 1
    return N


@pytest.mark.parametrize(("mode", "iterations", "kept"), [("invariant", 1, True), ("invariant", 2, True), ("ekf", 1, False), ("iekf", 2, False)])
def test_a_rotation_of_the_world_is_unobservable(rng: np.random.Generator, mode: str, iterations: int, kept: bool) -> None:
    """Nᵀ P⁻¹ N is the information about a rotation of the whole world, which measurements must not change; the EKF gains it wrongly."""
    s = team(rng)
    before = rotation_of_the_world(s) @ np.linalg.solve(s.P, rotation_of_the_world(s))
    for k in range(6):
        robot = k % 2
        seen = np.array([1 - robot, 2, 3, 4])
        z = np.array([exact(s, robot, j) for j in seen]) + rng.normal(size=(4, 2)) * [0.1, 0.05]
        update(s, settings(mode, iterations), robot, Scan(seen, z, np.tile([0.1, 0.05], (4, 1))))
    after = rotation_of_the_world(s) @ np.linalg.solve(s.P, rotation_of_the_world(s))
    assert (abs(after / before - 1) < 1e-6) == kept


def test_the_covariance_stays_positive_after_ten_thousand_updates(rng: np.random.Generator) -> None:
    s, n = team(rng), 10_000
    sigma = np.array([0.05, 0.02])
    z = np.array([[exact(s, robot, subject) for subject in (2, 3, 4, 1 - robot)] for robot in (0, 1)])
    order = np.arange(n)
    robot, subject = order % 2, order // 2 % 4
    seen = np.where(subject == 3, 1 - robot, subject + 2)
    noisy = z[robot, subject] + sigma * rng.normal(size=(n, 2))
    noise = np.tile([1e-5, 1e-6, 1e-5, 1e-10, 1e-10, 1e-10, 1e-10, 1e-10], (n, 1))
    events = (np.tile([STEP, SCAN], n), np.repeat(robot, 2), np.repeat(order, 2))
    schedule = EventSchedule(*events, np.zeros((n, 2)), noise, np.arange(n + 1), seen, noisy, np.tile(sigma, (n, 1)), np.repeat(order, 2) * 1.0, 0)
    run_filter(s, settings("invariant", 2, 3.0, 1.0), schedule)
    assert s.counts[:2].sum() == n
    np.testing.assert_array_equal(s.P, s.P.T)
    assert np.linalg.eigvalsh(s.P).min() > 0
    assert np.isfinite(s.mean).all()


def test_an_outlier_loses_weight_and_is_counted(rng: np.random.Generator) -> None:
    s = team(rng)
    s.P[:] = 1e-4 * np.eye(len(s.mean))
    with_outlier = copy(s)
    seen, sigma = np.array([2, 3, 4]), np.tile([0.05, 0.01], (3, 1))
    z = np.array([exact(s, 0, j) for j in seen])
    process_scan(s, settings("invariant", 2, 3.0), 0, Scan(seen, z, sigma))
    z[1] += [2.0, 1.0]
    process_scan(with_outlier, settings("invariant", 2, 3.0), 0, Scan(seen, z, sigma))
    assert np.abs(with_outlier.mean - s.mean).max() < 0.02
    assert with_outlier.counts[:2].tolist() == [2, 1]


def test_a_kidnapped_robot_recovers(rng: np.random.Generator) -> None:
    """The filter is certain of a pose 2 m from the true one: measurements are rejected until its covariance is inflated."""
    s = team(rng)
    s.P[:] = np.diag(np.full(len(s.mean), 1e-6))
    truth = s.mean[:3].copy()
    seen, sigma = np.array([2, 3, 4]), np.tile([0.05, 0.01], (3, 1))
    z = np.array([exact(s, 0, j) for j in seen])
    s.mean[:3] += [1.5, -1.4, 0.6]
    for _ in range(40):
        process_scan(s, settings("invariant", 2, 3.0, max_outlier_excess=12), 0, Scan(seen, z + rng.normal(size=z.shape) * sigma, sigma))
    assert s.counts[2] >= 1
    np.testing.assert_allclose(s.mean[:3], truth, atol=0.1)


def test_a_robot_corrects_the_robot_that_it_sees(rng: np.random.Generator) -> None:
    s = team(rng)
    s.P[:] = 0
    s.P[range(3), range(3)] = 1e-6
    s.P[range(ROBOT, ROBOT + 3), range(ROBOT, ROBOT + 3)] = 1.0
    process_scan(s, settings("invariant"), 0, Scan(np.array([1]), exact(s, 0, 1)[None], np.array([[0.05, 0.01]])))
    assert np.diag(s.P)[ROBOT : ROBOT + 2].max() < 0.01
