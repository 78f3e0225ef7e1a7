"""The motion model: delays, lags and scales of commands, and the noise of correlated measurements."""

from __future__ import annotations

import numpy as np
import pytest

from tracker.planar_slam.motion_model import Sensors, integrate, sighting_sigma, step_noise

PLAIN = Sensors(speed_delay=0.0, turn_delay=0.0, lag=1e-3, speed_scale=1.0, turn_scale=1.0, turn_loss=0.0)


def test_an_ideal_robot_moves_as_commanded() -> None:
    commands = np.array([[0.0, 0.5, 0.2], [4.0, 0.0, -0.1], [10.0, 0.0, 0.0]])
    motion = integrate(commands, Sensors(**{**vars(PLAIN), "command_timeout": 100.0}), np.array([0.0, 2.0, 4.0, 10.0]))
    np.testing.assert_allclose(motion, [[0, 0, 0], [1, 0.4, 0.4], [2, 0.8, 0.8], [2, 0.2, 1.4]], atol=0.02)


def test_delay_and_lag_shift_the_motion_but_not_its_length() -> None:
    commands, late = np.array([[0.0, 0.0, 0.0], [1.0, 1.0, 0.0], [2.0, 0.0, 0.0], [9.0, 0.0, 0.0]]), 0.25
    sensors = Sensors(**{**vars(PLAIN), "speed_delay": late, "lag": 0.1})
    motion = integrate(commands, sensors, np.array([1.0 + late, 1.5 + late, 6.0]))[:, 0]
    assert motion[0] == pytest.approx(0, abs=0.01)
    assert motion[1] == pytest.approx(0.4, abs=0.02)  # a lag of τ delays the motion by τ
    assert motion[2] == pytest.approx(1.0, abs=0.01)


def test_a_turn_loses_distance_down_to_zero() -> None:
    sensors = Sensors(**{**vars(PLAIN), "turn_loss": 0.1})
    fast = integrate(np.array([[0.0, 0.1, 0.5], [1.0, 0.0, 0.0]]), sensors, np.array([0.0, 3.0]))
    assert fast[1, 0] == pytest.approx(0.05, abs=0.005)
    slow = integrate(np.array([[0.0, 0.01, 2.0], [1.0, 0.0, 0.0]]), sensors, np.array([0.0, 3.0]))
    assert 0 <= slow[1, 0] < 0.005


def test_a_command_ends_at_its_timeout() -> None:
    motion = integrate(np.array([[0.0, 1.0, 0.0], [30.0, 0.0, 0.0]]), Sensors(**{**vars(PLAIN), "command_timeout": 2.0}), np.array([20.0]))
    assert motion[0, 0] == pytest.approx(2.0, abs=0.03)


def test_a_standing_robot_has_noise_in_its_offsets_alone() -> None:
    noise = step_noise(np.array([[0.0, 0.0, 0.0], [0.1, 0.1, 0.1]]), np.array([1.0, 1.0]), Sensors())
    assert not noise[0, :3].any()
    assert (noise[1] > 0).all()
    assert (noise[0, 3:] == np.square(Sensors().random_walk)).all()


def test_correlated_measurements_have_less_information() -> None:
    """100 measurements in 10 s with a correlation time of 1 s have about the information of 10 s / (2 · 1 s) independent ones."""
    seen = np.stack([np.arange(100) * 0.1, np.full(100, 3.0), np.zeros(100)], axis=1)
    subject, no_robots = np.full(100, 7), np.zeros(100, dtype=bool)
    once = sighting_sigma(seen[:1], subject[:1], no_robots[:1], Sensors(correlation_time=1.0))[0]
    sigma = sighting_sigma(seen, subject, no_robots, Sensors(correlation_time=1.0))
    information = (once[0] / sigma[1:, 0]) ** 2
    assert information.sum() == pytest.approx(5, rel=0.05)
    np.testing.assert_allclose(sighting_sigma(seen, subject, no_robots, Sensors(correlation_time=0.0))[:, 0], once[0])
