"""Inertial measurement units: white noise, bias and bias walk of named parts; and the sampling rates of all sensors on a rover.

The model is that of Kalibr and IEEE Std 952: a sample has white noise with standard deviation density/√dt. The bias is a random walk whose steps
have standard deviation walk·√dt. Allan deviations are then density/√τ and walk·√(τ/3).
A sample follows every n-th physics step, with a whole number n.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tracker.geometry import Array

_DEGREE, _MG = math.radians(1.0), 9.80665e-3
_TEMPERATURE_WALK = 0.03
"""K/√s: assumed random walk of a part's temperature, 0.2 K in a minute and 1.8 K in an hour. It turns a temperature coefficient into a bias walk."""
IMU_RATES = (100.0, 400.0)
"""Lowest and highest sampling rate of an IMU, Hz."""
WHEEL_RATES = (10.0, 400.0)
"""Lowest and highest sampling rate of the wheel encoders, Hz."""
LISTED = 10
"""Largest number of rates that an error message lists."""
_SAME = 1e-4
"""Relative tolerance of a requested rate: users write 28.2857 for 198/7."""


@dataclass(frozen=True)
class ImuPart:
    """Errors of a part; every value is per axis.

    gyro_noise rad/s/√Hz, gyro_walk rad/s²/√Hz, gyro_bias rad/s (one sigma at switching on).
    force_noise m/s²/√Hz, force_walk m/s³/√Hz, force_bias m/s², of the accelerometer. source: of the figures.
    """

    gyro_noise: float
    gyro_walk: float
    gyro_bias: float
    force_noise: float
    force_walk: float
    force_bias: float
    source: str


PARTS: dict[str, ImuPart] = {
    "adis16448": ImuPart(
        gyro_noise=1.6968e-4,
        gyro_walk=1.9393e-5,
        gyro_bias=0.5 * _DEGREE,
        force_noise=2.0e-3,
        force_walk=3.0e-3,
        force_bias=20 * _MG,
        source="Analog Devices ADIS16448: noise and walk of EuRoC MAV (Burri et al., IJRR 2016), imu0/sensor.yaml; initial biases of the data sheet",
    ),
    "bmi088": ImuPart(
        gyro_noise=0.014 * _DEGREE,
        gyro_walk=0.015 * _DEGREE * _TEMPERATURE_WALK,
        gyro_bias=1.0 * _DEGREE,
        force_noise=0.175 * _MG,
        force_walk=0.2 * _MG * _TEMPERATURE_WALK,
        force_bias=20 * _MG,
        source="Bosch BMI088, data sheet BST-BMI088-DS001: 0.014 °/s/√Hz, 0.015 °/s/K, ±1 °/s; 175 µg/√Hz, 0.2 mg/K, ±20 mg",
    ),
    "icm20948": ImuPart(
        gyro_noise=0.015 * _DEGREE,
        gyro_walk=0.05 * _DEGREE * _TEMPERATURE_WALK,
        gyro_bias=5.0 * _DEGREE,
        force_noise=0.23 * _MG,
        force_walk=0.8 * _MG * _TEMPERATURE_WALK,
        force_bias=50 * _MG,
        source="TDK InvenSense ICM-20948, data sheet DS-000189: 0.015 °/s/√Hz, 0.05 °/s/K, ±5 °/s; 230 µg/√Hz, 0.8 mg/K, ±50 mg",
    ),
    "ideal": ImuPart(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, source="no errors"),
}
"""Name → part. The sheets of bmi088 and icm20948 give no bias walk: it is their temperature coefficient times a random walk of the temperature."""


def parse_imu(text: str) -> tuple[str, float | None]:
    """Name of a part and rate, Hz or None, of a text NAME or NAME@HZ. Raises ValueError for another text or an unknown name."""
    name, at, hertz = text.partition("@")
    if name not in PARTS:
        raise ValueError(f"imu is {text[:60]!r}, needs NAME or NAME@HZ with a name of {', '.join(PARTS)}")
    try:
        rate = float(hertz) if at else None
    except ValueError:
        raise ValueError(f"imu is {text[:60]!r}, needs a number of Hz after @") from None
    return name, rate


class ImuErrors:
    """The errors of one IMU, sample by sample, with the current bias as state. dt: s between samples."""

    def __init__(self, part: ImuPart, dt: float, rng: np.random.Generator) -> None:
        self._noise = np.repeat([part.gyro_noise, part.force_noise], 3) / math.sqrt(dt)
        self._walk = np.repeat([part.gyro_walk, part.force_walk], 3) * math.sqrt(dt)
        self._rng = rng
        self._bias: Array = rng.normal(0.0, 1.0, 6) * np.repeat([part.gyro_bias, part.force_bias], 3)

    def draw(self, count: int) -> tuple[Array, Array]:
        """Biases and white noise, each (count, 6), of the next samples: gyroscope x, y, z rad/s, accelerometer x, y, z m/s²."""
        walk, noise = self._rng.normal(0.0, 1.0, (2, count, 6))
        bias = self._bias + np.cumsum(walk * self._walk, axis=0)
        if count:
            self._bias = bias[-1]
        return bias, noise * self._noise


def possible_rates(physics: float, bounds: tuple[float, float]) -> list[float]:
    """Rates, Hz, within bounds that a whole number of steps of `physics` steps/s gives, the highest first."""
    low, high = bounds
    rates = [physics / n for n in range(1, int(physics / low) + 2)]
    return [rate for rate in rates if low * (1 - _SAME) <= rate <= high * (1 + _SAME)]


def steps_a_sample(name: str, rate: float | None, physics: float, bounds: tuple[float, float]) -> int:
    """Number of physics steps per sample. rate: Hz, or None for the highest possible. physics: steps/s. name: of the option, for messages.

    Raises ValueError, which names the possible rates, for a rate out of bounds or one that no whole number of steps gives.
    """
    low, high = bounds
    if rate is not None and not low <= rate <= high:
        raise ValueError(f"{name} is {rate:g} Hz, needs {low:g} to {high:g} Hz")
    possible = possible_rates(physics, bounds)
    if not possible:
        raise ValueError(f"{name} needs {low:g} to {high:g} Hz, but the physics has {physics:g} steps/s; choose a smaller timestep")
    for each in possible:
        if rate is None or abs(each - rate) <= _SAME * rate:
            return round(physics / each)
    listed = ", ".join(f"{each:g}" for each in possible[:LISTED]) + (", …" if len(possible) > LISTED else "")
    raise ValueError(f"{name} is {rate:g} Hz, needs a whole number of physics steps: {listed} Hz (another timestep or frame rate gives others)")
