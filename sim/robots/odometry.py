"""Odometry of a low-cost rover: wheel encoders, gyroscope and accelerometer with systematic and random errors.

Systematic errors are constant for a whole run and cause drift. Random errors are drawn in each frame and are small in comparison.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from sim.robots.rover import WHEEL_RADIUS
from tracker.geometry import Array, Pose, exp_so3, frozen
from tracker.geometry.compilation import njit
from tracker.types import Odometry

GYRO_NOISE = math.radians(0.005)
"""rad/s/√Hz: rate noise density of an InvenSense MPU-6050 (product specification rev. 3.4, 6.1: 0.005 °/s/√Hz)."""
GYRO_BIAS = math.radians(0.2)
"""rad/s, one sigma per axis: residual bias of the MPU-6050 (zero-rate output ±20 °/s) after calibration at standstill and warming up."""
GYRO_SCALE = 0.01
"""One sigma of the scale factor: a third of the specified ±3 %."""
RADIUS_ERROR = 0.015
"""One sigma of the relative error of a side's effective wheel radius, by tyre pressure, load and wear."""
ENCODER_COUNTS = 1024
"""Encoder counts per turn of the wheel."""
ACCELEROMETER_NOISE = 400e-6 * 9.81
"""m/s²/√Hz: noise density of the MPU-6050's accelerometer (6.2: 400 µg/√Hz)."""
ACCELEROMETER_BIAS = 0.009 * 9.81
"""m/s², one sigma per axis: a quarter of the MPU-6050's offset change of ±35 mg from 0 to 70 °C, after calibration at standstill."""
ACCELEROMETER_SCALE = 0.01
"""One sigma of the accelerometer's scale factor, a third of ±3 %."""
LEG_DRIFT, VISUAL_DRIFT = 0.02, 0.008
"""Relative error of the distance, one sigma: of leg kinematics and an IMU (Bloesch et al. 2013, IROS: some per cent on slippery ground;
Wisth et al. 2022, VILENS: 1 to 2 %), and of cameras and an IMU (Geneva et al. 2020, OpenVINS: 0.5 to 1 % on EuRoC)."""
MOVED_NOISE = 0.002
"""m: part of the error of a frame's translation that does not grow with the translation."""
RESIDUAL_ACCELERATION = 0.15
"""Share of the true acceleration that a complementary filter leaves in its estimate of the vertical."""
_TYPICAL_ACCELERATION = 0.5
"""m/s²: typical acceleration of a rover, one sigma."""
_GRAVITY = 9.81


@dataclass(frozen=True, eq=False)
class SystematicErrors:
    """Errors of one rover's sensors that are constant for a run.

    radius (2,): assumed over true radius of the left and the right wheels. gyro_bias (3,) rad/s, gyro_scale (3,).
    accelerometer_bias (3,) m/s², accelerometer_scale (3,).
    """

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
    """True motion of a rover during one frame, body frame.

    rates (n, 3): angular velocity, rad/s, at n times dt s apart. wheels (2, 4): wheel angles at the start and at the end, rad.
    acceleration: (3,) m/s². up: (3,) unit vector, at the end.
    """

    rates: Array
    dt: float
    wheels: Array
    acceleration: Array
    up: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "rates", frozen(self.rates, (None, 3), "rates"))
        object.__setattr__(self, "wheels", frozen(self.wheels, (2, 4), "wheels"))


def measure_moved(motion: FrameMotion, moved: Array, systematic: SystematicErrors, drift: float, rng: np.random.Generator) -> Odometry:
    """Odometry of a robot without wheels: rotation from the gyroscope, translation from legs or cameras with a relative error.

    moved: (3,) m, in the body frame before. drift: one of LEG_DRIFT, VISUAL_DRIFT. The error is as systematic as that of a rover's wheels.
    """
    R = _measured_rotation(motion, systematic, rng)
    turn, period, distance = Pose(R, np.zeros(3)).log()[3:], motion.dt * len(motion.rates), float(np.linalg.norm(moved))
    scale = 1 + (systematic.radius.mean() - 1) * drift / RADIUS_ERROR
    random = MOVED_NOISE + 0.5 * drift * distance
    told = scale * moved + rng.normal(0.0, random, 3)
    along = np.hypot(random, 1.5 * drift * distance) * np.ones(3)
    about = np.sqrt(np.diag(covariance(distance, turn, period))[3:])
    return Odometry(Pose(R, told), np.diag(np.concatenate([along, about]) ** 2), *_gravity(motion, systematic, rng))


def measure(motion: FrameMotion, systematic: SystematicErrors, rng: np.random.Generator, axle: float = 0.0) -> Odometry:
    """Odometry of one frame: rotation from the gyroscope, translation from the mean of the wheels along the heading at half the rotation.

    axle: x of the point of the body that moves along the heading, m.
    """
    R = _measured_rotation(motion, systematic, rng)
    turn = Pose(R, np.zeros(3)).log()[3:]
    count = 2 * math.pi / ENCODER_COUNTS
    turned = np.floor(motion.wheels / count) * count
    left_right = (turned[1] - turned[0]).reshape(2, 2).mean(axis=0)
    distance = float((WHEEL_RADIUS * systematic.radius * left_right).mean())
    move = exp_so3(turn / 2) @ np.array([distance, 0.0, 0.0])
    if axle:
        move = move + (np.eye(3) - R)[:, 0] * axle
    period = motion.dt * len(motion.rates)
    return Odometry(Pose(R, move), covariance(distance, turn, period), *_gravity(motion, systematic, rng))


def _measured_rotation(motion: FrameMotion, systematic: SystematicErrors, rng: np.random.Generator) -> Array:
    """Rotation (3, 3) during a frame, from the gyroscope."""
    noise = rng.normal(0.0, GYRO_NOISE / math.sqrt(motion.dt), motion.rates.shape)
    return _integrate_rotation((motion.rates * systematic.gyro_scale + systematic.gyro_bias + noise) * motion.dt)


def _gravity(motion: FrameMotion, systematic: SystematicErrors, rng: np.random.Generator) -> tuple[Array, float]:
    """Up direction (3,), body frame, from the accelerometer, and its standard deviation, rad."""
    period = motion.dt * len(motion.rates)
    # The mean over a frame has the noise bandwidth 1 / (2 period).
    accelerometer_sigma = ACCELEROMETER_NOISE / math.sqrt(2 * period)
    force = (motion.up * _GRAVITY + RESIDUAL_ACCELERATION * motion.acceleration) * systematic.accelerometer_scale + systematic.accelerometer_bias
    up = force + rng.normal(0.0, accelerometer_sigma, 3)
    sigma = math.hypot(ACCELEROMETER_BIAS, accelerometer_sigma, RESIDUAL_ACCELERATION * _TYPICAL_ACCELERATION) / _GRAVITY
    return up / np.linalg.norm(up), sigma


@njit(cache=True)
def _integrate_rotation(steps: Array) -> Array:
    """Product (3, 3) of the rotations by the vectors steps (n, 3) rad, by Rodrigues' formula."""
    R = np.eye(3)
    for step in steps:
        angle = math.sqrt(step[0] ** 2 + step[1] ** 2 + step[2] ** 2)
        a = math.sin(angle) / angle if angle > 1e-9 else 1.0
        b = (1 - math.cos(angle)) / angle**2 if angle > 1e-5 else 0.5
        W = np.array([[0.0, -step[2], step[1]], [step[2], 0.0, -step[0]], [-step[1], step[0], 0.0]])
        R = R @ (np.eye(3) + a * W + b * (W @ W))
    return R


def covariance(distance: float, turn: Array, period: float) -> Array:
    """Covariance (6, 6) of one frame's odometry in the right tangent: `distance` m ahead, rotation vector `turn` (3,) rad in `period` s.

    It includes the systematic errors, hence errors of successive frames are not independent.
    """
    turned = float(np.linalg.norm(turn))
    along = [0.001, 0.001, 0.0005] + np.array([0.02, 0.01, 0.005]) * abs(distance) + np.array([0.015, 0.02, 0.005]) * turned
    about = np.hypot(GYRO_BIAS * period, GYRO_SCALE * np.abs(turn)) + 1e-4
    return np.diag(np.concatenate([along, about]) ** 2)
