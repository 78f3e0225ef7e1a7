"""States within a frame: rovers at the physics steps, people at the crowd steps, and both interpolated in between.

Between physics steps a rover moves on the geodesic of its pose. Limbs are interpolated linearly between crowd steps (0.05 s).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from sim.crowd.crowd import CrowdState
from sim.pedestrian import gait, skeleton
from sim.pedestrian.gait import Terrain
from tracker.geometry import Array, Pose, quaternion_from_rotation
from worlds.engine import mujoco


@dataclass(eq=False)
class FrameHistory:
    """States since the previous frame, whose state is the first of each list.

    timestep: s of a physics step. qpos: of all physics steps. people: crowd and footfalls at all steps of the crowd.
    head_yaw: (m,) rad at the previous frame and now. corrected: poses and headings → poses with sitters and raised arms.
    `poses` holds limb poses that were computed already.
    """

    timestep: float
    qpos: list[Array]
    people: list[tuple[CrowdState, gait.Footing]]
    head_yaw: tuple[Array, Array]
    corrected: Callable[[skeleton.Poses, Array], skeleton.Poses]
    poses: dict[int, skeleton.Poses] = field(default_factory=dict)

    @property
    def duration(self) -> float:
        """s between the two frames."""
        return self.timestep * (len(self.qpos) - 1)

    def rovers(self, model: mujoco.MjModel, before: float) -> Array:
        """Positions (nq,) of all joints `before` s before the end. Raises ValueError for a time outside of the frame."""
        k, share = self._place(before, len(self.qpos) - 1)
        if share == 0:
            return self.qpos[k].copy()
        velocity, out = np.zeros(model.nv), self.qpos[k].copy()
        mujoco.mj_differentiatePos(model, velocity, 1.0, self.qpos[k], self.qpos[k + 1])
        mujoco.mj_integratePos(model, out, velocity, share)
        return out

    def places(self, before: float) -> Array:
        """x, y (m, 2) m of all people `before` s before the end. People who were absent at the step before are treated as in `limbs`."""
        k, share = self._place(before, len(self.people) - 1)
        first = self.people[k][0]
        if share == 0:
            return first.position
        last = self.people[k + 1][0].position
        return np.asarray(np.where(first.present[:, None], (1 - share) * first.position + share * last, last))

    def limbs(self, stature: Array, ground: Terrain, before: float) -> tuple[Array, Array]:
        """Positions (m, limbs, 3) m and quaternions (m, limbs, 4) wxyz of the limbs `before` s before the end.

        People who were absent at the step before have their pose of the step after.
        """
        k, share = self._place(before, len(self.people) - 1)
        if share == 0:
            now = self._poses(stature, ground, k)
            return now.position, now.quaternion
        first, last = self._poses(stature, ground, k), self._poses(stature, ground, k + 1)
        weight = np.where(self.people[k][0].present, 1 - share, 0.0)[:, None, None]
        position = weight * first.position + (1 - weight) * last.position
        near = np.where((first.quaternion * last.quaternion).sum(axis=-1, keepdims=True) < 0, -first.quaternion, first.quaternion)
        quaternion = weight * near + (1 - weight) * last.quaternion
        return position, quaternion / np.linalg.norm(quaternion, axis=-1, keepdims=True)

    def _place(self, before: float, steps: int) -> tuple[int, float]:
        """The step at or before a time, and the elapsed share of the interval to the next step."""
        if not -1e-9 <= before <= self.duration + 1e-9:
            raise ValueError(f"before is {before} s, needs 0 to {self.duration:g}, the time since the frame before")
        at = steps * (1 - min(max(before / self.duration, 0.0), 1.0))
        whole = round(at)
        if abs(at - whole) < 1e-9 * steps or whole == at:
            return whole, 0.0
        return int(at), at - int(at)

    def _poses(self, stature: Array, ground: Terrain, k: int) -> skeleton.Poses:
        if k not in self.poses:
            state, footing = self.people[k]
            turned = self.head_yaw[0] + k / (len(self.people) - 1) * (self.head_yaw[1] - self.head_yaw[0])
            poses = skeleton.limb_poses(stature, footing, state.position, state.heading, ground)
            self.poses[k] = skeleton.with_head_yaw(self.corrected(poses, state.heading), turned)
        return self.poses[k]


@dataclass(frozen=True, eq=False)
class StepStates:
    """States at n + 1 instants, `timestep` s apart; the first is the end of the previous frame. r rovers.

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

    def at_sensors(self, mounts: Sequence[Pose]) -> StepStates:
        """The states of sensors, one per robot, at their own origins and in their own axes. mounts: T_body_sensor of each."""
        place, turn = np.array([T.translation for T in mounts]), np.array([quaternion_from_rotation(T.rotation) for T in mounts])
        if not place.any() and not turn[:, 1:].any():
            return self
        arm, rate = np.broadcast_to(place, self.position.shape), self.velocity[..., 3:]
        back = self.quaternion * [1, -1, -1, -1]
        velocity = self.velocity[..., :3] + _rotate_back(back, np.cross(rate, arm))
        rate = _rotate_back(np.broadcast_to(turn, self.quaternion.shape), rate)
        quaternion = _product(self.quaternion, np.broadcast_to(turn, self.quaternion.shape))
        position = self.position + _rotate_back(back, arm)
        return replace(self, position=position, quaternion=quaternion, velocity=np.concatenate([velocity, rate], axis=-1))

    def angular_velocity(self) -> Array:
        """Angular velocity (n, r, 3) rad/s, body frame, during each step. A step turns the body by exactly Exp(angular velocity · timestep)."""
        return self.velocity[1:, :, 3:]

    def specific_force(self) -> Array:
        """Mean specific force (n, r, 3) m/s², body frame, of each step: R^T (dv/dt - g), at the orientation in the middle of the step.

        The change of velocity in a step is exact, contacts included. MuJoCo's accelerometer reports the acceleration before the
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


def _product(a: Array, b: Array) -> Array:
    """Products of quaternions (..., 4) wxyz."""
    w, u, x, v = a[..., :1], a[..., 1:], b[..., :1], b[..., 1:]
    return np.concatenate([w * x - (u * v).sum(axis=-1, keepdims=True), w * v + x * u + np.cross(u, v)], axis=-1)
