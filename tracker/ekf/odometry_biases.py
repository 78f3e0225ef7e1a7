"""Correlated odometry errors as Gauss-Markov states: wheel slip, sliding on slopes, gyroscope bias and accelerometer bias.

Each robot has nine such states. Six are errors of the motion's right tangent, in units of the odometry's stated standard deviations.
One is the speed at which the wheels slide downhill, in m/s for a slope of sine 1. Two are errors of the measured "up" about the body's
x and y, in units of its standard deviation. Each is a first-order Gauss-Markov process with a stationary variance (Bar-Shalom, Li,
Kirubarajan 2001, 8.2). They are part of the filter's state.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tracker.ekf.lie_kernels import right_jacobian
from tracker.geometry import Array, Pose, exp_so3
from tracker.types import Odometry

MOTION_BIASES, BIASES = 7, 9
"""States per robot: six of the odometry and one of slopes act on the motion; with two of "up" there are nine."""


@dataclass(frozen=True)
class BiasModel:
    """The parameters of the nine processes.

    time_constants (8,) s: correlation times of the six, then of "up". sigma_ratios (8,): their stationary standard deviations over the stated ones,
    above 1 where wheels slip more than the odometry states. white_shares (7,): the share of the stated variance that is white noise, for the six and
    for "up". downhill_sigma m/s, downhill_time s: standard deviation and correlation time of sliding on slopes, which lasts as wheels and ground do.

    The defaults are fitted to rovers' odometry in rendered worlds, where errors of translation have a correlation of 0.85 between frames.
    """

    time_constants: tuple[float, ...] = (1.0, 1.0, 0.2, 60.0, 60.0, 10.0, 60.0, 60.0)
    sigma_ratios: tuple[float, ...] = (1.5, 1.5, 1.2, 1.0, 1.0, 1.0, 0.8, 0.8)
    white_shares: tuple[float, ...] = (0.3, 0.3, 0.3, 0.02, 0.02, 0.05, 0.4)
    downhill_sigma: float = 0.2
    downhill_time: float = 120.0

    def __post_init__(self) -> None:
        for name, length in (("time_constants", 8), ("sigma_ratios", 8), ("white_shares", 7)):
            values = getattr(self, name)
            if len(values) != length or not all(0 < v < np.inf for v in values):
                raise ValueError(f"{name} is {values}, needs {length} finite numbers more than 0")
        for name, value in (("downhill_sigma", self.downhill_sigma), ("downhill_time", self.downhill_time)):
            if not 0 < value < np.inf:
                raise ValueError(f"{name} is {value}, needs a finite number more than 0")

    @property
    def sigmas(self) -> Array:
        """The stationary standard deviations (9,) of the states, each in its unit."""
        return np.array([*self.sigma_ratios[:6], self.downhill_sigma, *self.sigma_ratios[6:]])

    def retention(self, period: float) -> Array:
        """The factor (9,) by which each bias decays in `period` s."""
        return np.asarray(np.exp(-period / np.array([*self.time_constants[:6], self.downhill_time, *self.time_constants[6:]])))

    def white_noise(self, odometry: Odometry) -> tuple[Array, float]:
        """The white part of the errors: the covariance (6, 6), and the standard deviation of "up", rad."""
        scale = np.sqrt(self.white_shares)
        return odometry.covariance * np.outer(scale[:6], scale[:6]), float(scale[6]) * odometry.gravity_sigma


def symmetric_root(covariance: Array) -> Array:
    """The symmetric square root (6, 6) of a covariance that may be singular."""
    value, vector = np.linalg.eigh(covariance)
    return np.asarray((vector * np.sqrt(np.maximum(value, 0.0))) @ vector.T)


def bias_scale(covariance: Array, up: Array, period: float) -> Array:
    """(6, 7): maps the biases of the motion to its right tangent.

    covariance (6, 6): stated by the odometry. up (3,): unit, in the body frame. period s.
    """
    downhill = np.append(-period * up[:2], np.zeros(4))
    return np.column_stack([symmetric_root(covariance), downhill])


def bias_corrected(motion: Pose, scale: Array, odometry_bias: Array) -> tuple[Pose, Array]:
    """The motion corrected for n biases, and the Jacobian (6, n) of its right tangent in the biases.

    scale (6, n): maps the biases to the right tangent of the motion.
    """
    error = scale @ odometry_bias
    turn = exp_so3(error[3:])
    G = np.concatenate([turn.T @ scale[:3], right_jacobian(error[None, 3:])[0] @ scale[3:]])
    return Pose(motion.rotation @ turn, motion.translation + motion.rotation @ error[:3]), G
