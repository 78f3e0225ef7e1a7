"""Noise and bias walk of IMU parts by Allan variances, and the sampling rates that the physics gives."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest
from scipy.stats import chi2

from sim.robots.imu import IMU_RATES, PARTS, WHEEL_RATES, ImuErrors, parse_imu, possible_rates, steps_a_sample

RATE, COUNT = 200.0, 200_000
RARE = 1e-7
"""Probability of a value beyond each of the bounds of a test."""


def allan_pairs(samples: np.ndarray, m: int) -> np.ndarray:
    """Squared half differences (pairs, 6) of means over m samples, of disjoint pairs; their mean is the Allan variance at m samples.

    In disjoint pairs, differences of white noise and of a random walk are independent, so that their sum is exactly chi-squared.
    """
    pairs = len(samples) // (2 * m)
    means = samples[: 2 * m * pairs].reshape(pairs, 2, m, 6).mean(axis=2)
    return 0.5 * (means[:, 1] - means[:, 0]) ** 2


def assert_variance(squares: np.ndarray, variance: np.ndarray) -> None:
    """The sum of squares (n, 6) is chi-squared for the variance (6,)."""
    n = len(squares)
    low, high = chi2.ppf([RARE, 1 - RARE], n) / n
    ratio = squares.mean(axis=0) / variance
    assert (low < ratio).all(), (ratio, low, high)
    assert (ratio < high).all(), (ratio, low, high)


@pytest.fixture(scope="module", params=[name for name in PARTS if name != "ideal"])
def drawn(request: pytest.FixtureRequest) -> tuple[str, np.ndarray, np.ndarray]:
    """A part at rest for 1000 s, in pieces as a recording draws them: name, biases and noise."""
    errors = ImuErrors(PARTS[request.param], 1 / RATE, np.random.default_rng(7))
    bias, noise = (np.concatenate(parts) for parts in zip(*(errors.draw(COUNT // 16) for _ in range(16)), strict=True))
    return request.param, bias, noise


def figures(name: str) -> tuple[np.ndarray, np.ndarray]:
    part = PARTS[name]
    return np.repeat([part.gyro_noise, part.force_noise], 3), np.repeat([part.gyro_walk, part.force_walk], 3)


@pytest.mark.soak
def test_allan_variance_is_that_of_the_figures(drawn: tuple[str, np.ndarray, np.ndarray]) -> None:
    """N²/τ of white noise plus K²τ/3·(1 + 1/(2m²)) of the bias walk, at short and long τ = m/rate."""
    name, bias, noise = drawn
    density, walk = figures(name)
    for m in (1, 10, 200, 4000, 20_000):
        tau = m / RATE
        assert_variance(allan_pairs(bias + noise, m), density**2 / tau + walk**2 * tau / 3 * (1 + 1 / (2 * m**2)))
        assert_variance(allan_pairs(bias, m), walk**2 * tau / 3 * (1 + 1 / (2 * m**2)))


@pytest.mark.soak
def test_initial_biases_have_the_stated_spread() -> None:
    for part in PARTS.values():
        first = np.array([ImuErrors(part, 1 / RATE, np.random.default_rng(k)).draw(1)[0][0] for k in range(400)])
        sigma = np.repeat([part.gyro_bias, part.force_bias], 3)
        if sigma.any():
            assert_variance(first**2, sigma**2)


def test_the_ideal_part_has_no_errors() -> None:
    bias, noise = ImuErrors(PARTS["ideal"], 1 / RATE, np.random.default_rng(0)).draw(10)
    assert not bias.any()
    assert not noise.any()


def test_names_and_rates() -> None:
    assert parse_imu("bmi088") == ("bmi088", None)
    assert parse_imu("adis16448@198") == ("adis16448", 198.0)
    for text in ("mpu", "", "BMI088", "@200"):
        with pytest.raises(ValueError, match="needs NAME or NAME@HZ with a name of adis16448, bmi088, icm20948, ideal"):
            parse_imu(text)
    with pytest.raises(ValueError, match="needs a number of Hz after @"):
        parse_imu("bmi088@fast")


def test_rates_are_whole_numbers_of_steps() -> None:
    assert possible_rates(198.0, IMU_RATES) == [198.0]
    assert possible_rates(400.0, IMU_RATES) == [400.0, 200.0, 400 / 3, 100.0]
    assert steps_a_sample("imu", None, 1000.0, IMU_RATES) == 3
    assert steps_a_sample("wheels", 28.2857, 198.0, WHEEL_RATES) == 7
    for rate, physics, message in (
        (200.0, 198.0, "imu is 200 Hz, needs a whole number of physics steps: 198 Hz (another timestep"),
        (150.0, 400.0, "needs a whole number of physics steps: 400, 200, 133.333, 100 Hz"),
        (99.0, 198.0, "imu is 99 Hz, needs 100 to 400 Hz"),
        (math.nan, 198.0, "imu is nan Hz, needs 100 to 400 Hz"),
        (None, 80.0, "the physics has 80 steps/s; choose a smaller timestep"),
    ):
        with pytest.raises(ValueError, match=re.escape(message)):
            steps_a_sample("imu", rate, physics, IMU_RATES)
