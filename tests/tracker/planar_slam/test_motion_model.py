"""The sensor model: delays, lags and scales of commands, and the noise of sightings that hang together."""

from __future__ import annotations

import numpy as np
import pytest

from tracker.planar_slam.motion_model import Sensors, integrate, sighting_sigma, step_noise

PLAIN = Sensors(speed_delay=0.0, turn_delay=0.0, lag=1e-3, speed_scale=1.0, turn_scale=1.0, turn_costs=0.0)


def test_an_obedient_robot_goes_as_far_as_it_was_told() -> None:
    commands = np.array([[0.0, 0.5, 0.2], [4.0, 0.0, -0.1], [10.0, 0.0, 0.0]])
    way = integrate(commands, Sensors(**{**vars(PLAIN), "hold": 100.0}), np.array([0.0, 2.0, 4.0, 10.0]))
    np.testing.assert_allclose(way, [[0, 0, 0], [1, 0.4, 0.4], [2, 0.8, 0.8], [2, 0.2, 1.4]], atol=0.02)


def test_delay_and_lag_move_the_way_but_not_its_length() -> None:
    commands, late = np.array([[0.0, 0.0, 0.0], [1.0, 1.0, 0.0], [2.0, 0.0, 0.0], [9.0, 0.0, 0.0]]), 0.25
    sensors = Sensors(**{**vars(PLAIN), "speed_delay": late, "lag": 0.1})
    way = integrate(commands, sensors, np.array([1.0 + late, 1.5 + late, 6.0]))[:, 0]
    assert way[0] == pytest.approx(0, abs=0.01)
    assert way[1] == pytest.approx(0.4, abs=0.02)  # a lag of τ costs τ of the way until it has settled
    assert way[2] == pytest.approx(1.0, abs=0.01)


def test_a_turn_costs_way_and_never_more_than_there_is() -> None:
    sensors = Sensors(**{**vars(PLAIN), "turn_costs": 0.1})
    fast = integrate(np.array([[0.0, 0.1, 0.5], [1.0, 0.0, 0.0]]), sensors, np.array([0.0, 3.0]))
    assert fast[1, 0] == pytest.approx(0.05, abs=0.005)
    slow = integrate(np.array([[0.0, 0.01, 2.0], [1.0, 0.0, 0.0]]), sensors, np.array([0.0, 3.0]))
    assert 0 <= slow[1, 0] < 0.005


def test_a_command_that_is_not_renewed_is_over() -> None:
    way = integrate(np.array([[0.0, 1.0, 0.0], [30.0, 0.0, 0.0]]), Sensors(**{**vars(PLAIN), "hold": 2.0}), np.array([20.0]))
    assert way[0, 0] == pytest.approx(2.0, abs=0.03)


def test_a_robot_that_stands_has_no_noise_but_in_its_offsets() -> None:
    noise = step_noise(np.array([[0.0, 0.0, 0.0], [0.1, 0.1, 0.1]]), np.array([1.0, 1.0]), Sensors())
    assert not noise[0, :3].any()
    assert (noise[1] > 0).all()
    assert (noise[0, 3:] == np.square(Sensors().walk)).all()


def test_a_row_of_sightings_of_one_thing_tells_as_much_as_its_memory_allows() -> None:
    """100 sightings in 10 s whose errors last 1 s are worth about as much as 10 s / (2 · 1 s) independent ones."""
    seen = np.stack([np.arange(100) * 0.1, np.full(100, 3.0), np.zeros(100)], axis=1)
    subject, nobody = np.full(100, 7), np.zeros(100, dtype=bool)
    once = sighting_sigma(seen[:1], subject[:1], nobody[:1], Sensors(memory=1.0))[0]
    sigma = sighting_sigma(seen, subject, nobody, Sensors(memory=1.0))
    worth = (once[0] / sigma[1:, 0]) ** 2
    assert worth.sum() == pytest.approx(5, rel=0.05)
    np.testing.assert_allclose(sighting_sigma(seen, subject, nobody, Sensors(memory=0.0))[:, 0], once[0])


@pytest.mark.parametrize("name", ["lag", "hold", "range_sigma", "bearing_sigma"])
def test_parameters_have_bounds(name: str) -> None:
    with pytest.raises(ValueError, match=f"{name} is 0, needs more than 0"):
        Sensors(**{name: 0})
