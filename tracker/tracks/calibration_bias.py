"""How far each view is off on the ground for good: what its calibration gets wrong, or what its robot does not know of its own tilt.

An offset is that at the middle of the ground and, for cameras that stand still, a slope: on PETS 2009 what two views say of one place differs by
0.3 m here and by 0.8 m ten metres farther. It is learned while tracking, by the innovations of those who are known. Offsets are known against each
other alone, so that the first view is taken to be off by little where that is asked for.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from tracker.geometry import Array
from tracker.types import Setup


@dataclass(frozen=True)
class RegistrationBiasParameters:
    """Standard deviations at first."""

    sigma: float = 0.3  # m, of a view's offset; 0 switches offsets off
    first: float = 0.3  # m, of the first view's: where it is small, places are told as that view sees them
    slope: float = 0.0  # m a metre, of how an offset changes over the ground, of cameras that stand still ...
    slope_first: float = 0.0  # ... and of the first of them
    memory: float = 30.0  # innovations that are worth one independent look: they come in runs


class RegistrationBias:
    """Of each camera the offset (2,) m at `centre`, its derivative by x and y row by row, and the covariance (6, 6) of these."""

    def __init__(self, setup: Setup, parameters: RegistrationBiasParameters) -> None:
        self.parameters, p = parameters, parameters
        still = [robot for robot in setup.starts if setup.is_fixed(robot)]
        places = [start.T_world_robot.translation[:2] for robot, start in setup.starts.items() if start is not None and robot in still]
        self.centre = setup.area.mean(axis=0) if setup.area is not None else np.mean(places, axis=0) if places else np.zeros(2)
        self._known: dict[str, tuple[Array, Array]] = {}
        for k, (camera, mount) in enumerate(setup.mounts.items()):
            sigma, slope = (p.sigma, p.slope) if k else (min(p.first, p.sigma), p.slope_first)
            slope *= mount.robot in still and p.sigma > 0
            self._known[camera] = np.zeros(6), np.diag([sigma**2] * 2 + [slope**2] * 4)

    def of(self, camera: str) -> Array:
        """(6,): offset m and its derivative."""
        return self._known[camera][0]

    def at(self, camera: str, place: Array) -> Array:
        """Offset (n, 2) m of `camera` at places (n, 2) m."""
        known = self.of(camera)
        return np.asarray(known[:2] + (place - self.centre) @ known[2:].reshape(2, 2).T)

    def learn(self, camera: str, place: Array, looks: tuple[Array, Array, Array]) -> None:
        """Take innovations at places (k, 2) m as looks at the camera's offset, by Kalman's update, S widened as looks are not independent. looks:
        residual (k, 2) or (k, 1), NaN where there is none, H its derivative by x and y, and S its covariance."""
        if self.parameters.sigma > 0:
            self._known[camera] = _learnt(self._known[camera], place - self.centre, looks, self.parameters.memory)


@njit(cache=True)
def _learnt(known: tuple[Array, Array], place: Array, looks: tuple[Array, Array, Array], memory: float) -> tuple[Array, Array]:
    x, P = known
    J = np.zeros((2, 6))
    J[0, 0] = J[1, 1] = 1.0
    for k in range(len(place)):
        residual, H, S = looks[0][k], looks[1][k], looks[2][k]
        if np.isfinite(residual).all():
            J[0, 2:4] = J[1, 4:6] = place[k]
            full = H @ J
            # What is known of the offset is in the residual already.
            K = np.linalg.solve(full @ P @ full.T + memory * S, full @ P).T.copy()
            x, P = x + K @ residual, P - K @ full @ P
    return x, P
