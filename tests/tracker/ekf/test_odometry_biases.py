"""Odometry biases: their Gauss-Markov process, Jacobians, and estimation by the filter."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.tracker.walled_room import Room, simulate
from tracker.ekf.gaussian import nees
from tracker.ekf.linearization import linearize
from tracker.ekf.odometry_biases import BIASES, MOTION_BIASES, BiasModel, bias_corrected, bias_scale, symmetric_root
from tracker.ekf.state import JointState, LinearizedMeasurement
from tracker.geometry import Pose, exp_so3
from tracker.slam.filter import Slam
from tracker.slam.parameters import SlamParameters
from tracker.types import Odometry, Start, Tick

RULE = BiasModel()
BIASES_OF = {"r0": (0.0, 0.0, 0.0, 1.0, 1.0, -1.0), "r1": (0.0, 0.0, 0.0, 1.0, -1.0, 1.0)}
"""Biases of the robots' rotation, in stated standard deviations."""


def test_the_symmetric_root_squares_to_a_singular_covariance() -> None:
    rng = np.random.default_rng(1)
    A = rng.normal(size=(6, 4))
    np.testing.assert_allclose(symmetric_root(A @ A.T) @ symmetric_root(A @ A.T), A @ A.T, atol=1e-12)
    np.testing.assert_allclose(symmetric_root(np.diag([4.0, 0, 1, 9, 0, 1])), np.diag([2.0, 0, 1, 3, 0, 1]), atol=1e-12)


@pytest.mark.parametrize("size", [0.3, 1e-8])
def test_the_jacobian_of_the_corrected_motion_against_differences(size: float) -> None:
    rng = np.random.default_rng(2)
    motion, odometry_bias = Pose.exp(rng.normal(size=6)), size * rng.normal(size=MOTION_BIASES)
    A = rng.normal(size=(6, 6))
    scale = bias_scale(A @ A.T, np.array([0.6, 0.0, 0.8]), 0.5)
    there, G = bias_corrected(motion, scale, odometry_bias)
    for axis, step in enumerate(1e-6 * np.eye(MOTION_BIASES)):
        ahead, back = (bias_corrected(motion, scale, odometry_bias + sign * step)[0] for sign in (1, -1))
        difference = ((there.inverse() @ ahead).log() - (there.inverse() @ back).log()) / 2e-6
        np.testing.assert_allclose(G[:, axis], difference, atol=1e-6)


def test_the_variance_of_a_path_with_correlated_errors() -> None:
    """Straight ahead for n steps: Var = (ratio σ)² Σᵢⱼ ρ^|i − j| + n σ² of white noise, derived by hand from the process."""
    joint, n, sigma, period = JointState(1, 1, None, "iekf", RULE), 20, 0.01, 0.2
    joint.add_robot(Start(Pose.identity(), np.zeros((6, 6))))
    odometry = Odometry(Pose(np.eye(3), np.array([0.1, 0, 0])), np.diag([sigma**2, 0, 0, 0, 0, 0]))
    white, _ = RULE.white_noise(odometry)
    for _ in range(n):
        joint.decay_biases(RULE.retention(period))
        joint.predict(0, odometry.T_before_now, white, bias_scale(odometry.covariance, np.array([0.0, 0.0, 1.0]), period))
    apart = np.abs(np.subtract.outer(np.arange(n), np.arange(n)))
    expected = sigma**2 * ((RULE.sigma_ratios[0] ** 2 * np.exp(-period / RULE.time_constants[0]) ** apart).sum() + n * RULE.white_shares[0])
    assert joint.P[0, 0] == pytest.approx(expected, rel=1e-12)
    np.testing.assert_allclose(np.diag(joint.P[6 : 6 + BIASES, 6 : 6 + BIASES]), np.square(RULE.sigmas), rtol=1e-12)


def biased(ticks: list[Tick], truth: list[dict[str, Pose]]) -> list[Tick]:
    """The ticks with constant biases of each robot's rotation, one stated standard deviation about each axis, and no other errors."""
    out = []
    for before, now, tick in zip(truth[:-1], truth[1:], ticks[1:], strict=True):
        views = []
        for v, name in zip(tick.views, BIASES_OF, strict=True):
            assert v.odometry is not None
            error = np.array(BIASES_OF[name]) * np.sqrt(np.diag(v.odometry.covariance))
            views.append(replace(v, odometry=replace(v.odometry, T_before_now=before[name].inverse() @ now[name] @ Pose.exp(-error))))
        out.append(replace(tick, views=tuple(views)))
    return [ticks[0], *out]


@pytest.mark.soak
def test_a_gyroscope_bias_is_estimated() -> None:
    setup, ticks, truth, _ = simulate(Room(robots=2, ticks=70, landmarks=90, seed=3))
    nees_of = {}
    for rule in (None, RULE):
        slam, consistency = Slam(setup, SlamParameters(mode="fej", odometry_biases=rule, rotation_correlation_time=0.0)), []
        for tick, true in zip(biased(ticks, truth), truth, strict=True):
            slam.step(tick)
            consistency += [nees((slam.pose(name).inverse() @ true[name]).log()[3:], slam.covariance(name)[3:, 3:]) for name in true]
        nees_of[rule] = float(np.mean(consistency))
    assert nees_of[RULE] < 2
    assert nees_of[None] > 2 * nees_of[RULE]
    np.testing.assert_allclose(slam._joint.odometry_bias[:, 3:6], np.array(list(BIASES_OF.values()))[:, 3:], atol=0.5)


def test_sliding_downhill_is_estimated_from_known_landmarks() -> None:
    """A robot stands across a slope of sine 0.3 and slides at 0.1 m/s of sine, which its odometry does not state."""
    rng, period, speed = np.random.default_rng(4), 0.2, 0.1
    rotation = exp_so3(np.array([0.0, -np.arcsin(0.3), 0.0])) @ exp_so3(np.array([0.0, 0.0, 0.8]))
    joint = JointState(1, 1, None, "fej", RULE)
    joint.add_robot(Start(Pose(rotation, np.zeros(3)), 1e-6 * np.eye(6)))
    downhill = rotation @ np.append(-rotation[2, :2], 0.0)
    assert downhill[2] < 0
    odometry = Odometry(Pose.identity(), np.diag([1e-3**2] * 3 + [1e-4**2] * 3))
    white, _ = RULE.white_noise(odometry)
    place = np.zeros(3)
    for _ in range(200):
        place = place + speed * period * downhill
        joint.decay_biases(RULE.retention(period))
        joint.predict(0, odometry.T_before_now, white, bias_scale(odometry.covariance, joint.rotation[0][2], period))
        H = np.zeros((4, joint.stride))
        H[:3, :3] = np.eye(3)
        seen = rotation.T @ (place - joint.translation[0]) + 0.002 * rng.normal(size=3)
        measured = LinearizedMeasurement(np.arange(joint.stride), H, np.append(seen, 0.0), np.tile(0.002**2 * np.eye(2), (2, 1, 1)))
        joint.update(lambda measured=measured: measured, 1, np.inf)  # type: ignore[misc]
    assert joint.odometry_bias[0, 6] == pytest.approx(speed, abs=0.02)
    assert np.linalg.norm(joint.translation[0] - place) < 0.005


def test_the_jacobian_of_gravity_in_its_biases_against_differences() -> None:
    """ "Up" alone, exactly as predicted: the derivative of the residual in the two biases of "up"."""
    joint = JointState(1, 1, None, "fej", RULE)
    joint.add_robot(Start(Pose.exp(np.array([0.0, 0, 0, 0.1, -0.2, 0.7])), 1e-4 * np.eye(6)))
    up = joint.rotation[0].T @ np.array([0.0, 0.0, 9.8])
    odometry = Odometry(Pose.identity(), np.zeros((6, 6)), up, 0.02)

    def system() -> LinearizedMeasurement:
        return linearize(joint, 0, None, odometry)

    kept, here, columns = joint.odometry_bias.copy(), system(), []
    for axis in (7, 8):
        ends = []
        for sign in (1, -1):
            joint.odometry_bias = kept.copy()
            joint.odometry_bias[0, axis] += sign * 1e-5
            ends.append(system().residual)
        columns.append((ends[1] - ends[0]) / 2e-5)
    H = here.H.reshape(2, -1)[:, joint.stride - 2 : joint.stride]
    np.testing.assert_allclose(H, np.array(columns).T, atol=1e-6)
