"""Errors of odometry that last: a slip goes on for about a second, what a gyroscope or an accelerometer is off by for minutes.

Eight numbers a robot stand for them: six, in standard deviations of what the odometry itself states (its covariance), along and about the axes of
the motion's right tangent, and two, in standard deviations of "up" as the filter believes it, about the body's x and y. Each is a Gauss-Markov
process of the first order (Bar-Shalom, Li, Kirubarajan 2001, 8.2): what it was before, faded, and as much anew that its spread stays. The filter
keeps them in its state.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tracker.ekf.lie_kernels import right_jacobian
from tracker.geometry import Array, Pose, exp_so3
from tracker.types import Odometry

COUNT = 8
"""Numbers a robot: six of the odometry, two of "up"."""


@dataclass(frozen=True)
class BiasModel:
    """memory s, spread: of each of the eight, the time over which it fades and its standard deviation in those that are stated (over 1 where wheels
    slip more than the odometry says); white: of the six and of "up", the share of the stated variance that is new at every tick.

    The defaults come from what rovers' odometry in rendered worlds is off by: along and across 0.85 of an error is still there a frame later.
    """

    memory: tuple[float, ...] = (1.0, 1.0, 0.2, 60.0, 60.0, 10.0, 60.0, 60.0)
    spread: tuple[float, ...] = (1.5, 1.5, 1.2, 1.0, 1.0, 1.0, 0.8, 0.8)
    white: tuple[float, ...] = (0.3, 0.3, 0.3, 0.02, 0.02, 0.05, 0.4)

    def __post_init__(self) -> None:
        for name, length in (("memory", COUNT), ("spread", COUNT), ("white", COUNT - 1)):
            values = getattr(self, name)
            if len(values) != length or not all(0 < v < np.inf for v in values):
                raise ValueError(f"{name} is {values}, needs {length} finite numbers more than 0")

    def kept(self, period: float) -> Array:
        """The share (8,) of each that is left after `period` s."""
        return np.asarray(np.exp(-period / np.array(self.memory)))

    def whitened(self, odometry: Odometry) -> tuple[Array, float]:
        """What is new at every tick: the covariance (6, 6), and the standard deviation of "up", rad."""
        scale = np.sqrt(self.white)
        return odometry.covariance * np.outer(scale[:6], scale[:6]), float(scale[6]) * odometry.gravity_sigma


def root(covariance: Array) -> Array:
    """The symmetric root (6, 6) of a covariance that may be flat in some directions."""
    value, vector = np.linalg.eigh(covariance)
    return np.asarray((vector * np.sqrt(np.maximum(value, 0.0))) @ vector.T)


def bias_corrected(motion: Pose, scale: Array, lasting: Array) -> tuple[Pose, Array]:
    """The motion with lasting errors (6,) put right, scale (6, 6) being what one of each makes of its right tangent; and how (6, 6) the right tangent
    of the result hangs on them.
    """
    error = scale @ lasting
    turn = exp_so3(error[3:])
    G = np.concatenate([turn.T @ scale[:3], right_jacobian(error[None, 3:])[0] @ scale[3:]])
    return Pose(motion.rotation @ turn, motion.translation + motion.rotation @ error[:3]), G
