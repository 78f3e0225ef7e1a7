"""Motion of robots that do not roll: a base that follows its path over the ground, flight by thrust and moments, or a user's controller.

A walking robot is moved kinematically: its base is parallel to the ground and its legs swing, without contact forces.
A flying robot is simulated: only thrust along its own z axis and moments act on it (Lee et al. 2010, "Geometric tracking control of a
quadrotor UAV on SE(3)").
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from sim.robots.controller import CheckedController, DriveCommand, RobotState
from sim.robots.driving import DriveState
from sim.robots.robot_choice import BASE, CONTROLLED, THRUST, WHEELS
from sim.robots.user_robot import UserRobot
from sim.simulation.initial_states import rotation_on_slope
from tracker.geometry import Array, Ints, Pose, quaternion_from_rotation, rotation_from_quaternion, rotation_z
from worlds.engine import mujoco
from worlds.terrain.walk_surface import Terrain

STRIDE = 1.6
"""Length of a step cycle over the height of the base."""
SWING, LIFT = 0.35, 0.5
"""rad: amplitude of the hips, and of the knees while a foot is off the ground, at WALKING_SPEED."""
WALKING_SPEED = 0.7
FOOT_ARM = 0.3
"""m: distance from the centre of a walking robot to its feet, which move while it turns."""
SPEED_GAIN, HEIGHT_GAIN, CLIMB_GAIN = 1.2, 4.0, 3.0
"""1/s, 1/s², 1/s: gains of velocity, height and climb rate of a flying robot."""
ATTITUDE, RATE = 60.0, 14.0
"""1/s² and 1/s: gains of attitude and of angular velocity, over the moment of inertia; damped by 0.9."""
MOST_TILT = math.radians(25)
SMOOTH = 0.35
"""m driven until the base has adopted the slope of the ground."""


@dataclass
class _Course:
    """Course of a robot: x, y m, yaw rad; up (3,) of the ground, smoothed; gait cycles walked; speed of its feet, m/s."""

    x: float
    y: float
    yaw: float
    up: Array
    walked: float = 0.0
    speed: float = 0.0


class GuidedRobots:
    """The robots of a simulation without driven wheels.

    `before` and, after the step, `after` are called with every physics step.

    robots: index of the robot in the simulation → its description.
    """

    def __init__(self, robots: dict[int, UserRobot], model: mujoco.MjModel, terrain: Terrain, camera_height: float) -> None:
        self._robots = {k: robot for k, robot in robots.items() if robot.motion != WHEELS}
        self._model, self._terrain, self._camera_height = model, terrain, camera_height
        self._courses: dict[int, _Course] = {}
        self._address: dict[int, tuple[int, int]] = {}
        self._before: dict[int, Array] = {}
        self._joints: dict[int, tuple[Ints, Ints, Array, tuple[Ints, Array]]] = {}
        for k, robot in self._robots.items():
            joint = model.joint(f"robot_{k}")
            self._address[k] = int(joint.qposadr[0]), int(joint.dofadr[0])
            ids = np.array([model.joint(f"robot_{k}/{name}").id for name in robot.rest], dtype=np.int64)
            legs = self._leg_addresses(k, robot)
            self._joints[k] = model.jnt_qposadr[ids], model.jnt_dofadr[ids], np.array(list(robot.rest.values())), legs
        self._balances = self._balance() if self._robots else {}
        self._controlled = {k: self._controller(k, robot) for k, robot in self._robots.items() if robot.motion == CONTROLLED}

    def _controller(self, k: int, robot: UserRobot) -> tuple[CheckedController, Ints]:
        """The controller of a robot, and its actuators. Raises ValueError, with the file, as CheckedController.of."""
        prefix = f"robot_{k}/"
        at = [a for a in range(self._model.nu) if self._model.actuator(a).name.startswith(prefix)]
        try:
            return CheckedController.of(robot.choice.controller, len(at)), np.array(at, dtype=np.int64)
        except ValueError as error:
            raise ValueError(f"{robot.path}: {error}") from None

    def _leg_addresses(self, k: int, robot: UserRobot) -> tuple[Ints, Array]:
        """Position addresses (legs, 3) of hips, knees and ankles, and back, lift, phase, by_hip, by_knee (legs, 5)."""
        names = [(leg.hip, leg.knee, leg.ankle or leg.hip) for leg in robot.legs]
        at = [[self._model.joint(f"robot_{k}/{name}").qposadr[0] for name in joints] for joints in names]
        turns = [(leg.back, leg.lift, leg.phase, leg.by_hip, leg.by_knee) for leg in robot.legs]
        return np.array(at, dtype=np.int64).reshape(-1, 3), np.array(turns).reshape(-1, 5)

    def __contains__(self, robot: int) -> bool:
        return robot in self._robots

    def start(self, k: int, place: Array, yaw: float) -> Array:
        """Position and quaternion (7,) of a robot that starts at place (2,) m."""
        self._courses[k] = _Course(float(place[0]), float(place[1]), yaw, self._slope(k, place, yaw))
        return _row(self._standing(k))

    def save(self) -> dict[int, tuple[float, ...]]:
        """The state that MjData does not hold."""
        return {k: (c.x, c.y, c.yaw, *c.up.tolist(), c.walked, c.speed) for k, c in self._courses.items()}

    def restore(self, state: dict[int, tuple[float, ...]]) -> None:
        """Restore a state of `save`."""
        self._courses = {k: _Course(x, y, yaw, np.array(rest[:3]), *rest[3:5]) for k, (x, y, yaw, *rest) in state.items()}

    def before(self, data: mujoco.MjData, drives: list[DriveState], dt: float) -> None:
        """Advance the courses by a physics step of `dt` s, and apply the forces of flight. The poses are kept for the velocities of `after`."""
        self._before = {k: data.qpos[q : q + 7].copy() for k, (q, _) in self._address.items()}
        for k, robot in self._robots.items():
            course, drive = self._courses[k], drives[k]
            if robot.motion == CONTROLLED:
                self._control(k, data, drive)
                continue
            course.yaw += drive.yaw_rate * dt
            if robot.motion == THRUST:
                self._fly(k, data, drive.speed)
                continue
            course.x += drive.speed * dt * math.cos(course.yaw)
            course.y += drive.speed * dt * math.sin(course.yaw)
            course.speed = abs(drive.speed) + FOOT_ARM * abs(drive.yaw_rate)
            course.walked += drive.speed * dt / (STRIDE * max(robot.height, 0.15)) + 0.3 * abs(drive.yaw_rate) * dt
            share = min(1.0, course.speed * dt / SMOOTH)
            up = course.up + share * (self._slope(k, np.array([course.x, course.y]), course.yaw) - course.up)
            course.up = up / np.linalg.norm(up)

    def after(self, data: mujoco.MjData, dt: float) -> None:
        """Set the poses and velocities of walking robots after a physics step."""
        for k, robot in self._robots.items():
            if robot.motion != BASE:
                if robot.motion == THRUST:
                    self._hold(k, data)
                continue
            q, v = self._address[k]
            before = Pose(rotation_from_quaternion(self._before[k][3:]), self._before[k][:3])
            pose = self._standing(k)
            data.qpos[q : q + 7] = _row(pose)
            data.qvel[v : v + 3] = (pose.translation - before.translation) / dt
            data.qvel[v + 3 : v + 6] = Pose(before.rotation.T @ pose.rotation, np.zeros(3)).log()[3:] / dt
            self._hold(k, data)
            self._swing(k, data)

    def _hold(self, k: int, data: mujoco.MjData) -> None:
        """Hold the joints of the robot at rest."""
        positions, velocities, rest, _ = self._joints[k]
        data.qpos[positions], data.qvel[velocities] = rest, 0.0

    def _swing(self, k: int, data: mujoco.MjData) -> None:
        """Move the legs by the gait phase: a foot moves back on the ground, and forward when lifted. Ankles keep the feet level."""
        course, (at, legs) = self._courses[k], self._joints[k][3]
        if not len(at):
            return
        phase = 2 * np.pi * (course.walked + legs[:, 2])
        strength = min(1.0, course.speed / WALKING_SPEED)
        hip = legs[:, 0] * SWING * strength * np.sin(phase)
        knee = legs[:, 1] * LIFT * strength * np.maximum(0.0, -np.cos(phase))
        for joint, turn in enumerate((hip, knee, legs[:, 3] * hip + legs[:, 4] * knee)):
            data.qpos[at[:, joint]] += turn

    def _slope(self, k: int, place: Array, yaw: float) -> Array:
        """Upward normal (3,) of the plane through the ground under the feet."""
        feet = self._robots[k].feet @ rotation_z(yaw)[:2, :2].T
        # Feet on one line or point do not define a plane.
        feet = feet + 0.05 * np.array([(1, 1), (1, -1), (-1, 1), (-1, -1)])
        A = np.column_stack([feet, np.ones(4)])
        east, north, _ = np.linalg.lstsq(A, self._terrain.height_at(place + feet), rcond=None)[0]
        up = np.array([-east, -north, 1.0])
        return np.asarray(up / np.linalg.norm(up))

    def _standing(self, k: int) -> Pose:
        """The pose of a robot on its course: at its height, parallel to the ground. A flying robot is level, at its hover height."""
        course, robot = self._courses[k], self._robots[k]
        ground = float(self._terrain.height_at(np.array([[course.x, course.y]]))[0])
        if robot.flies:
            return Pose(rotation_z(course.yaw), np.array([course.x, course.y, ground + robot.hover(self._camera_height)]))
        feet = robot.feet @ rotation_z(course.yaw)[:2, :2].T + [course.x, course.y]
        mean = float(np.mean(self._terrain.height_at(feet)))
        return Pose(rotation_on_slope(course.up, course.yaw), np.array([course.x, course.y, 0.5 * (mean + ground) + robot.height]))

    def _control(self, k: int, data: mujoco.MjData, drive: DriveState) -> None:
        """Set the controls of a robot by its controller."""
        q, v = self._address[k]
        robot, (controller, actuators) = self._robots[k], self._controlled[k]
        position = data.qpos[q : q + 3].copy()
        ground = float(self._terrain.height_at(position[None, :2])[0])
        at, speed_at, _, _ = self._joints[k]
        joints, speeds = (dict(zip(robot.rest, values.tolist(), strict=True)) for values in (data.qpos[at], data.qvel[speed_at]))
        rotation, velocity, rate = rotation_from_quaternion(data.qpos[q + 3 : q + 7]), data.qvel[v : v + 3].copy(), data.qvel[v + 3 : v + 6].copy()
        state = RobotState(float(data.time), position, rotation, velocity, rate, float(position[2]) - ground, joints, speeds)
        height = robot.hover(self._camera_height) if robot.flies else robot.height
        data.ctrl[actuators] = controller.controls(state, DriveCommand(drive.speed, drive.yaw_rate, height))

    def _fly(self, k: int, data: mujoco.MjData, speed: float) -> None:
        """Apply thrust and moment for a speed, m/s, along the course's yaw, at the robot's height over the ground."""
        q, v = self._address[k]
        robot, course = self._robots[k], self._courses[k]
        position, R = data.qpos[q : q + 3], rotation_from_quaternion(data.qpos[q + 3 : q + 7])
        velocity, rate = data.qvel[v : v + 3], data.qvel[v + 3 : v + 6]
        course.x, course.y = float(position[0]), float(position[1])
        ground = float(self._terrain.height_at(position[None, :2])[0])
        gravity = -float(self._model.opt.gravity[2])
        wanted = speed * rotation_z(course.yaw)[:, 0]
        a = SPEED_GAIN * (wanted - velocity)
        a[2] = HEIGHT_GAIN * (ground + robot.hover(self._camera_height) - position[2]) - CLIMB_GAIN * velocity[2] + gravity
        a[2] = max(a[2], 0.3 * gravity)
        level, most = math.hypot(a[0], a[1]), math.tan(MOST_TILT) * a[2]
        a[:2] *= min(1.0, most / level) if level > 0 else 1.0
        z = a / np.linalg.norm(a)
        y = np.cross(z, rotation_z(course.yaw)[:, 0])
        y = y / np.linalg.norm(y)
        target = np.stack([np.cross(y, z), y, z], axis=1)
        error = 0.5 * (target.T @ R - R.T @ target)
        lean = np.array([error[2, 1], error[0, 2], error[1, 0]])
        inertia, arm = self._balances[k]
        thrust = robot.mass * float(a @ R[:, 2]) * R[:, 2]
        moment = inertia @ (-ATTITUDE * lean - RATE * rate) + np.cross(rate, inertia @ rate)
        data.qfrc_applied[v : v + 3] = thrust
        data.qfrc_applied[v + 3 : v + 6] = moment + np.cross(arm, R.T @ thrust)

    def _balance(self) -> dict[int, tuple[Array, Array]]:
        """Flying robot → moment of inertia (3, 3) kg m² about its origin, and its centre of mass (3,) m, body frame. Its joints rest."""
        data, out = mujoco.MjData(self._model), {}
        for k in self._robots:
            self._hold(k, data)
        mujoco.mj_forward(self._model, data)
        full = np.zeros((self._model.nv, self._model.nv))
        mujoco.mj_fullM(self._model, data, full)
        for k, (q, v) in self._address.items():
            T = Pose(rotation_from_quaternion(data.qpos[q + 3 : q + 7]), data.qpos[q : q + 3])
            centre = T.inverse().apply(data.subtree_com[self._model.joint(f"robot_{k}").bodyid[0]][None])[0]
            out[k] = full[v + 3 : v + 6, v + 3 : v + 6].copy(), centre
        return out


def _row(pose: Pose) -> Array:
    return np.concatenate([pose.translation, quaternion_from_rotation(pose.rotation)])
