"""States of the rovers at the physics steps of a frame, and the angular velocity and specific force that follow from them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tracker.geometry import Array


@dataclass(frozen=True, eq=False)
class StepStates:
    """States at n + 1 instants, `timestep` s apart; the first is the end of the frame before. r rovers.

    gravity (3,) m/s², world frame. wheels (n+1, r, 4): wheel angles, rad.
    position (n+1, r, 3) m and quaternion (n+1, r, 4) wxyz of T_world_robot.
    velocity (n+1, r, 6): linear m/s in the world frame, of the body's origin; angular rad/s in the body frame.
    """

    timestep: float
    gravity: Array
    position: Array
    quaternion: Array
    velocity: Array
    wheels: Array

    def angular_velocity(self) -> Array:
        """Angular velocity (n, r, 3) rad/s, body frame, during each step. A step turns the body by exactly Exp(angular velocity · timestep)."""
        return self.velocity[1:, :, 3:]

    def specific_force(self) -> Array:
        """Mean specific force (n, r, 3) m/s², body frame, of each step: R^T (dv/dt - g), at the orientation in the middle of the step.

        The change of velocity in a step is exact, contacts included. The acceleration that MuJoCo's accelerometer reports is that before the
        implicit integration of damping.
        """
        acceleration = np.diff(self.velocity[:, :, :3], axis=0) / self.timestep - self.gravity
        middle = self.quaternion[1:] + self.quaternion[:-1]
        return _rotate_back(middle / np.linalg.norm(middle, axis=-1, keepdims=True), acceleration)


def _rotate_back(quaternion: Array, vector: Array) -> Array:
    """R^T v for unit quaternions (..., 4) wxyz of R and vectors (..., 3)."""
    w, u = quaternion[..., :1], quaternion[..., 1:]
    turned = np.cross(u, vector)
    return vector - 2 * w * turned + 2 * np.cross(u, turned)
