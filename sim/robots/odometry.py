"""Dead reckoning of a low-cost rover: wheel encoders, gyroscope and accelerometer, their errors, and what they say about the last frame.

Errors that stay the same for a whole run (Wear) make the reckoning drift; those drawn anew each frame are small beside them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numba import njit

from sim.robots.rover import WHEEL_RADIUS
from tracker.geometry import Array, Pose, exp_so3, frozen
from tracker.types import Odometry

GYRO_NOISE = math.radians(0.005)
"""rad/s/√Hz: rate noise density of an InvenSense MPU-6050 (product specification rev. 3.4, 6.1: 0.005 °/s/√Hz)."""
GYRO_BIAS = math.radians(0.2)
"""rad/s, one sigma an axis: what is left of the MPU-6050's zero-rate output of ±20 °/s after it was averaged at a standstill and then warmed up."""
GYRO_SCALE = 0.01
"""One sigma of the scale factor: the specified ±3 % taken as three sigmas."""
RADIUS_ERROR = 0.015
"""One sigma of a side's effective wheel radius over the nominal one: tyre pressure, load, wear."""
ENCODER_COUNTS = 1024
"""Encoder counts a turn of the wheel."""
ACCELEROMETER_NOISE = 400e-6 * 9.81
"""m/s²/√Hz: noise density of the MPU-6050's accelerometer (6.2: 400 µg/√Hz)."""
ACCELEROMETER_BIAS = 0.009 * 9.81
"""m/s², one sigma an axis: a quarter of the ±35 mg by which the MPU-6050's zero changes from 0 to 70 °C, after it was calibrated at a standstill."""
ACCELEROMETER_SCALE = 0.01
"""One sigma of its scale factor, as that of the gyroscope (±3 %)."""
RESIDUAL_ACCELERATION = 0.15
"""The share of the real acceleration that a complementary filter leaves in what it takes for up."""
_TYPICAL_ACCELERATION = 0.5
"""m/s²: what a rover usually accelerates by, one sigma."""
_GRAVITY = 9.81


@dataclass(frozen=True, eq=False)
class SystematicErrors:
    """What is wrong with one rover for good: radius (2,), what it takes for the left and right wheels' radius over the true one;
    gyro_bias (3,) rad/s; gyro_scale (3,); accelerometer_bias (3,) m/s²; accelerometer_scale (3,)."""

    radius: Array
    gyro_bias: Array
    gyro_scale: Array
    accelerometer_bias: Array = field(default_factory=lambda: np.zeros(3))
    accelerometer_scale: Array = field(default_factory=lambda: np.ones(3))

    @staticmethod
    def draw(rng: np.random.Generator) -> SystematicErrors:
        return SystematicErrors(
            1 + rng.normal(0.0, RADIUS_ERROR, 2),
            rng.normal(0.0, GYRO_BIAS, 3),
            1 + rng.normal(0.0, GYRO_SCALE, 3),
            rng.normal(0.0, ACCELEROMETER_BIAS, 3),
            1 + rng.normal(0.0, ACCELEROMETER_SCALE, 3),
        )


@dataclass(frozen=True, eq=False)
class FrameMotion:
    """What truly happened in one frame: rates (n, 3) rad/s of the body about its own axes at n even moments dt s apart; wheels (2, 4) rad,
    the angles of the wheels before and now; acceleration (3,) m/s² of the body in its own frame; up (3,) unit in its own frame now."""

    rates: Array
    dt: float
    wheels: Array
    acceleration: Array
    up: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "rates", frozen(self.rates, (None, 3), "rates"))
        object.__setattr__(self, "wheels", frozen(self.wheels, (2, 4), "wheels"))


def measure(motion: FrameMotion, systematic: SystematicErrors, rng: np.random.Generator) -> Odometry:
    """The odometry of one frame: turned by the gyroscope, moved ahead by the mean of the wheels at half of the turn."""
    noise = rng.normal(0.0, GYRO_NOISE / math.sqrt(motion.dt), motion.rates.shape)
    R = _integrate_rotation((motion.rates * systematic.gyro_scale + systematic.gyro_bias + noise) * motion.dt)
    turn = Pose(R, np.zeros(3)).log()[3:]
    count = 2 * math.pi / ENCODER_COUNTS
    turned = np.floor(motion.wheels / count) * count
    left_right = (turned[1] - turned[0]).reshape(2, 2).mean(axis=0)
    distance = float((WHEEL_RADIUS * systematic.radius * left_right).mean())
    move = exp_so3(turn / 2) @ np.array([distance, 0.0, 0.0])
    period = motion.dt * len(motion.rates)
    # The mean over a frame has a bandwidth of 1 / (2 period).
    accelerometer_sigma = ACCELEROMETER_NOISE / math.sqrt(2 * period)
    force = (motion.up * _GRAVITY + RESIDUAL_ACCELERATION * motion.acceleration) * systematic.accelerometer_scale + systematic.accelerometer_bias
    up = force + rng.normal(0.0, accelerometer_sigma, 3)
    sigma = math.hypot(ACCELEROMETER_BIAS, accelerometer_sigma, RESIDUAL_ACCELERATION * _TYPICAL_ACCELERATION) / _GRAVITY
    return Odometry(Pose(R, move), covariance(distance, turn, period), up / np.linalg.norm(up), sigma)


@njit(cache=True)
def _integrate_rotation(steps: Array) -> Array:
    """(3, 3): the product of the rotations by the vectors steps (n, 3) rad, by Rodrigues' formula."""
    R = np.eye(3)
    for step in steps:
        angle = math.sqrt(step[0] ** 2 + step[1] ** 2 + step[2] ** 2)
        a = math.sin(angle) / angle if angle > 1e-9 else 1.0
        b = (1 - math.cos(angle)) / angle**2 if angle > 1e-5 else 0.5
        W = np.array([[0.0, -step[2], step[1]], [step[2], 0.0, -step[0]], [-step[1], step[0], 0.0]])
        R = R @ (np.eye(3) + a * W + b * (W @ W))
    return R


def covariance(distance: float, turn: Array, period: float) -> Array:
    """(6, 6) of the right tangent of one frame's odometry: `distance` m ahead, turned by the rotation vector `turn` (3,) rad in `period` s.

    It holds the errors that stay the same as well, so successive frames are not independent.
    """
    turned = float(np.linalg.norm(turn))
    along = [0.001, 0.001, 0.0005] + np.array([0.02, 0.01, 0.005]) * abs(distance) + np.array([0.015, 0.02, 0.005]) * turned
    about = np.hypot(GYRO_BIAS * period, GYRO_SCALE * np.abs(turn)) + 1e-4
    return np.diag(np.concatenate([along, about]) ** 2)
