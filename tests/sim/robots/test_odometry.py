import math

import numpy as np
import pytest

from sim.robots import odometry
from sim.robots.odometry import GYRO_BIAS, GYRO_NOISE, RADIUS_ERROR, FrameMotion, SystematicErrors, covariance, measure
from sim.robots.rover import WHEEL_RADIUS
from tracker.geometry import Pose, exp_so3

N, DT = 33, 1 / 198
PERFECT = SystematicErrors(np.ones(2), np.zeros(3), np.ones(3))
UP = np.array([0.0, 0.0, 1.0])


def ride(speed: float, yaw_rate: float, frames: float = 1.0, acceleration: float = 0.0) -> FrameMotion:
    """Level motion without slip over some frames of 1/6 s."""
    n = round(N * frames)
    before = np.array([0.3, 1.0, 2.0, -5.0])
    turned = speed * n * DT / WHEEL_RADIUS
    return FrameMotion(np.tile([0.0, 0.0, yaw_rate], (n, 1)), DT, np.stack([before, before + turned]), np.array([acceleration, 0.0, 0.0]), UP)


def arc(speed: float, yaw_rate: float, seconds: float) -> Pose:
    angle = yaw_rate * seconds
    if abs(angle) < 1e-12:
        return Pose.planar(speed * seconds, 0.0, 0.0)
    r = speed / yaw_rate
    return Pose.planar(r * math.sin(angle), r * (1 - math.cos(angle)), angle)


@pytest.mark.parametrize(("speed", "yaw_rate"), [(0.0, 0.0), (0.7, 0.0), (0.5, 0.8), (-0.3, -0.5), (0.0, 0.8)])
def test_a_perfect_rover_measures_the_arc(speed, yaw_rate):
    odo = measure(ride(speed, yaw_rate), PERFECT, np.random.default_rng(0))
    error = (odo.T_before_now.inverse() @ arc(speed, yaw_rate, N * DT)).log()
    # Half a count of each of two encoders, the noise of the gyroscope, and the chord for the arc.
    assert np.abs(error[:3]).max() < 2 * math.pi * WHEEL_RADIUS / odometry.ENCODER_COUNTS + 1e-4
    assert np.abs(error[3:]).max() < 5 * GYRO_NOISE * math.sqrt(N * DT)


def test_systematic_errors_cause_drift_of_their_size():
    wear = SystematicErrors(np.array([1.02, 1.02]), np.array([0.0, 0.0, 0.01]), np.ones(3))
    odo = measure(ride(0.6, 0.0, 6.0), wear, np.random.default_rng(0))
    assert odo.T_before_now.yaw == pytest.approx(0.01, abs=1e-3)
    assert np.linalg.norm(odo.T_before_now.translation) == pytest.approx(1.02 * 0.6, abs=2e-3)


@pytest.mark.soak
def test_systematic_errors_have_the_stated_spread():
    wears = [SystematicErrors.draw(np.random.default_rng(k)) for k in range(600)]
    assert np.std([w.radius for w in wears]) == pytest.approx(RADIUS_ERROR, rel=0.1)
    assert np.std([w.gyro_bias for w in wears]) == pytest.approx(GYRO_BIAS, rel=0.1)


def test_covariance_is_sound_and_grows_with_way_and_turn():
    still, far, turned = (
        np.diag(covariance(*args)) for args in ((0.0, np.zeros(3), 0.1), (1.0, np.zeros(3), 0.1), (0.0, np.array([0, 0, 0.5]), 0.1))
    )
    assert still.min() > 0
    assert (far[:3] > still[:3]).all()
    assert (turned[:2] > still[:2]).all()
    assert turned[5] > still[5]
    assert (covariance(-1.0, np.zeros(3), 0.1) == covariance(1.0, np.zeros(3), 0.1)).all()


@pytest.mark.soak
def test_errors_without_slip_fit_the_covariance():
    nees = []
    for k in range(400):
        rng = np.random.default_rng(k)
        speed, yaw_rate = rng.uniform(-0.3, 0.7), rng.uniform(-0.8, 0.8)
        odo = measure(ride(speed, yaw_rate), SystematicErrors.draw(rng), rng)
        error = (odo.T_before_now.inverse() @ arc(speed, yaw_rate, N * DT)).log()
        nees.append(error[3:] @ np.linalg.solve(odo.covariance[3:, 3:], error[3:]) / 3)
    assert 0.5 < np.mean(nees) < 1.5


def test_up_is_up_within_its_sigma():
    tilt = exp_so3(np.array([0.1, -0.2, 0.0]))
    angles = []
    for k in range(500):
        still = ride(0.0, 0.0)
        up = tilt.T @ UP
        rng = np.random.default_rng(k)
        odo = measure(FrameMotion(still.rates, DT, still.wheels, np.zeros(3), up), SystematicErrors.draw(rng), rng)
        assert np.linalg.norm(odo.gravity) == pytest.approx(1.0)
        angles.append(np.arccos(np.clip(odo.gravity @ up, -1, 1)) / odo.gravity_sigma)
    # Two axes of one sigma each, of which the bias is the larger part.
    assert 0.4 < np.mean(np.square(angles)) / 2 < 1.1


def test_up_leans_with_acceleration():
    odo = measure(ride(0.3, 0.0, acceleration=1.5), PERFECT, np.random.default_rng(0))
    assert odo.gravity[0] > 0.005
