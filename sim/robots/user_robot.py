"""User robots: any MJCF model, attached to a scene inside an added body, with its motion, stance and camera.

The pose of the body `robot_N` is the robot's true pose: x forward, y left, z up, at the origin of the robot's own root body.
"""

from __future__ import annotations

import os
import re
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from sim.robots import rover
from sim.robots.robot_choice import BASE, CONTROLLED, THRUST, WHEELS, RobotChoice
from tracker.geometry import Array, Pose
from worlds.attachment import CAMERA_AXES, read_model, take_options
from worlds.engine import mujoco
from worlds.triangles import geom_triangles

WIDEST = 1.1
"""m: largest width. A wider robot does not fit through the free space for wheels."""
DRAWN, HIDDEN = 3, 4
"""Groups of the geoms of robots."""
FLYING = re.compile("prop|rotor|drone|quad(rotor|copter)|thrust", re.IGNORECASE)
MOST_STEER = 1.2
"""rad: largest angle of a steered wheel that is used."""
GAP = 0.1
"""m from the highest point of a robot up to its panorama, where neither a camera nor a site is specified."""


@dataclass(frozen=True)
class Wheel:
    """A wheel: name of its joint, its centre x, y m in the body, radius m; sign of its rotation in forward driving.

    steer: the vertical joint that turns its axle, "" for a fixed one; steer_sign: of its turn to the left; most_steer: rad.
    turns: rotation, rad, per metre forward, per metre to the left, and per radian of the robot's turn to the left. () for a wheel without rollers.
    """

    joint: str
    x: float
    y: float
    radius: float
    sign: float
    steer: str = ""
    steer_sign: float = 1.0
    most_steer: float = 0.0
    turns: tuple[float, ...] = ()


@dataclass(frozen=True)
class Leg:
    """A leg: hip and knee, joints that swing it fore and aft; phase in [0, 1).

    back, lift: signs of the turn of the hip that swings it back, and of the knee that lifts the foot.
    ankle: the joint that keeps the foot level, "" for none. by_hip, by_knee: its rotation per radian of the hip and of the knee.
    """

    hip: str
    knee: str
    back: float
    lift: float
    phase: float
    ankle: str = ""
    by_hip: float = 0.0
    by_knee: float = 0.0


@dataclass(frozen=True, eq=False)
class UserRobot:
    """A robot of a user at rest.

    rest: joint → position. height: m of the body's origin over level ground. top: m of its highest point over the origin. mass: kg.
    feet (4, 2) m: corners of the rectangle on which it stands. told_camera: T_body_camera as specified; None for a camera on a mast.
    imu: T_body_imu. flies: whether it moves by thrust, or has a controller and names of a flying robot. spec: of its file, without keyframes.
    """

    choice: RobotChoice
    path: Path
    spec: mujoco.MjSpec
    root: str
    motion: str
    rest: dict[str, float]
    height: float
    top: float
    mass: float
    feet: Array
    told_camera: Pose | None
    imu: Pose
    flies: bool
    wheels: tuple[Wheel, ...] = ()
    legs: tuple[Leg, ...] = ()
    drawn: frozenset[int] = field(default_factory=frozenset)

    def mount(self, camera_height: float) -> Pose:
        """T_body_camera of the panorama: as specified, or `camera_height` m above the ground and above the robot. On a flying robot: GAP above it."""
        if self.told_camera is not None:
            return self.told_camera
        up = self.top + GAP if self.flies else max(camera_height - self.height, self.top + GAP)
        return Pose(np.eye(3), np.array([0.0, 0.0, up]))

    def hover(self, camera_height: float) -> float:
        """Height of a flying robot's origin above the ground, m, with its camera at `camera_height`; at least 0.3 m."""
        return max(camera_height - float(self.mount(camera_height).translation[2]), 0.3)

    @property
    def driven(self) -> tuple[Wheel, ...]:
        """The wheels that are driven: those on fixed axles, or all where all are steered."""
        return tuple(wheel for wheel in self.wheels if not wheel.steer) or self.wheels

    @property
    def steered(self) -> tuple[Wheel, ...]:
        """The wheels that are steered."""
        return tuple(wheel for wheel in self.wheels if wheel.steer)

    @property
    def axle(self) -> float:
        """x of the middle of the driven wheels, m: that point moves along the heading."""
        return float(np.mean([wheel.x for wheel in self.driven])) if self.wheels else 0.0

    @property
    def turning_radius(self) -> float:
        """m: least turning radius of a robot with steered wheels; 0 for a robot that turns in place."""
        return max((abs(w.x - self.axle) / np.tan(w.most_steer) + abs(w.y) for w in self.steered), default=0.0)

    @property
    def servos(self) -> list[str]:
        """Names of the added actuators, in the order of `wheel_commands`: driven wheels and steering joints. A controller sets those of the file."""
        joints = [*(wheel.joint for wheel in self.driven), *(wheel.steer for wheel in self.steered)]
        return [f"servo/{joint}" for joint in joints] if self.motion == WHEELS else []

    def add_to(self, spec: mujoco.MjSpec, name: str, camera_height: float) -> None:
        """Add the robot to the world body of `spec` as the body and free joint `name`; its own names have the prefix `name/`."""
        child = self.spec.copy()
        _strip(child, self)
        take_options(spec, child)
        body = spec.worldbody.add_body(name=name)
        # MuJoCo requires mass on a body with a joint.
        body.explicitinertial, body.mass, body.inertia = True, 1e-4, np.full(3, 1e-7)
        body.add_freejoint(name=name)
        frame = body.add_frame()
        frame.attach_body(child.body(self.root), f"{name}/", "")
        if self.told_camera is None and not self.flies:
            rover.add_mast(body, name, float(self.mount(camera_height).translation[2]), max(self.top - 0.05, 0.0))
        if self.motion == WHEELS:
            self._add_servos(spec, name)

    def _add_servos(self, spec: mujoco.MjSpec, name: str) -> None:
        """Add the motors of driven wheels and of steering; other joints with limits, such as those of arms, are held at rest."""
        for wheel in self.driven:
            servo = spec.add_actuator(name=f"{name}/servo/{wheel.joint}", trntype=mujoco.mjtTrn.mjTRN_JOINT, target=f"{name}/{wheel.joint}")
            # The gain of a rover, scaled by mass and radius. All wheels together have twice the torque that holds the robot on a vertical wall.
            servo.set_to_velocity(kv=3.0 * self.mass * wheel.radius)
            most = 2 * 9.81 * self.mass * wheel.radius / len(self.driven)
            servo.forcelimited, servo.forcerange = mujoco.mjtLimited.mjLIMITED_TRUE, (-most, most)
        for wheel in self.steered:
            servo = spec.add_actuator(name=f"{name}/servo/{wheel.steer}", trntype=mujoco.mjtTrn.mjTRN_JOINT, target=f"{name}/{wheel.steer}")
            servo.set_to_position(kp=10.0 * self.mass * wheel.radius, kv=1.0 * self.mass * wheel.radius)
        moved = {part for wheel in self.wheels for part in (wheel.joint, wheel.steer)}
        for joint, place in self.rest.items():
            of_file = self.spec.joint(joint)
            if joint not in moved and bool(of_file.limited) and of_file.range[0] < of_file.range[1]:
                held = spec.add_equality(type=mujoco.mjtEq.mjEQ_JOINT, name=f"{name}/held/{joint}", name1=f"{name}/{joint}")
                held.objtype, held.data[0] = mujoco.mjtObj.mjOBJ_JOINT, place - of_file.ref


def _strip(child: mujoco.MjSpec, robot: UserRobot) -> None:
    """Remove sensors, lights and the free joint; actuators of robots without a controller; contacts of walking and flying robots without one."""
    for part in (*(child.actuators if robot.motion != CONTROLLED else ()), *child.sensors):
        child.delete(part)
    for number, actuator in enumerate(child.actuators):
        # Attaching adds a prefix to names, by which GuidedRobots finds the actuators.
        actuator.name = actuator.name or f"actuator{number}"
    root = child.body(robot.root)
    for joint in list(root.joints):
        if joint.type == mujoco.mjtJoint.mjJNT_FREE:
            child.delete(joint)
    root.pos = [0, 0, 0]
    for light in list(child.lights):
        child.delete(light)
    for geom in child.geoms:
        geom.group = DRAWN if geom.group in robot.drawn else HIDDEN
        if robot.motion in (BASE, THRUST):
            geom.contype = geom.conaffinity = 0
    if robot.motion in (BASE, THRUST):
        for body in root.find_all("body"):
            body.gravcomp = 0.0 if robot.motion == THRUST else 1.0


@lru_cache(maxsize=16)
def load_robot(choice: RobotChoice) -> UserRobot:
    """The robot of a choice. Raises ValueError, in one line, for a robot that cannot be found, read, attached or moved, or lacks its camera."""
    path = _path(choice.source)
    spec, model = read_model(path)
    data = mujoco.MjData(model)
    if model.nkey:
        data.qpos[:] = model.key_qpos[0]
    mujoco.mj_forward(model, data)
    children = [body for body in range(1, model.nbody) if model.body_parentid[body] == 0]
    if not children:
        raise ValueError(f"{path}: has no body, needs one that is the robot")
    parts = [[geom for geom in range(model.ngeom) if model.body_rootid[model.geom_bodyid[geom]] == body] for body in children]
    chosen = int(np.argmax([len(geoms) for geoms in parts]))
    root, geoms = children[chosen], parts[chosen]
    if not model.body(root).name:
        raise ValueError(f"{path}: its root body has no name, needs one")
    if model.body(root).name not in {body.name for body in spec.bodies}:
        raise ValueError(f"{path}: root body {model.body(root).name!r} cannot be attached")
    return _measured(choice, (path, spec), (model, data), root, geoms)


def _path(source: str) -> Path:
    """The file of a name or path. Raises ValueError for an unknown name, and where the menagerie cannot be reached."""
    if Path(source).suffix:
        if not Path(source).is_file():
            raise ValueError(f"robot {source}: no such file")
        if Path(source).suffix.lower() not in (".xml", ".mjcf", ".urdf"):
            raise ValueError(f"robot {source}: is no model of a robot, needs MJCF (.xml) or URDF")
        return Path(source)
    try:
        import mujoco_menagerie
    except ImportError:
        raise ValueError(f"robot {source}: a name of MuJoCo Menagerie needs the extra robots: pip install 'pilsim[robots]'; or FILE.xml") from None
    if source not in mujoco_menagerie.names():
        import difflib

        near = difflib.get_close_matches(source, mujoco_menagerie.names(), 3, 0.4)
        raise ValueError(f"robot is {source!r}, needs rover, FILE.xml or a name of MuJoCo Menagerie{', as ' + ', '.join(near) if near else ''}")
    try:
        return Path(mujoco_menagerie.get(source).path())
    # The package raises its own errors and those of the network.
    except Exception as error:
        where = "" if os.environ.get("MENAGERIE_ROOT") else "; MENAGERIE_ROOT names a local copy"
        raise ValueError(f"robot {source}: cannot be fetched ({' '.join(str(error).split())[:120]}){where}") from None


def _measured(choice: RobotChoice, file: tuple[Path, mujoco.MjSpec], scene: tuple[Any, Any], root: int, geoms: list[int]) -> UserRobot:
    """The robot, measured from its geometry at rest."""
    (path, spec), (model, data) = file, scene
    drawn = _drawn_groups(model, geoms)
    T_root = Pose(data.xmat[root].reshape(3, 3), data.xpos[root])
    # The root keeps its own rotation: forward is the x axis of the frame in which the file places it.
    T_root = Pose(np.eye(3), T_root.translation) if not _is_free(model, root) else T_root
    shown = [geom for geom in geoms if model.geom_group[geom] in drawn and model.geom_rgba[geom, 3] > 0]
    if not shown:
        raise ValueError(f"{path}: nothing of it is drawn")
    points = np.concatenate([geom_triangles(model, data, geom).reshape(-1, 3) for geom in shown])
    points = T_root.inverse().apply(points)
    low, high = points.min(axis=0), points.max(axis=0)
    if high[1] - low[1] > WIDEST:
        wide = f"is {high[1] - low[1]:.2f} m wide, needs at most {WIDEST:g} m"
        raise ValueError(f"{path}: {wide}: it does not fit through doors (fold its arms in a keyframe)")
    standing = points[points[:, 2] < low[2] + 0.08 * (high[2] - low[2]) + 0.01]
    a, b = standing[:, :2].min(axis=0), standing[:, :2].max(axis=0)
    feet = np.array([(b[0], b[1]), (b[0], a[1]), (a[0], b[1]), (a[0], a[1])])
    wheels = _wheels(model, data, T_root, float(low[2]), geoms)
    names = " ".join(model.geom(g).name + model.body(int(model.geom_bodyid[g])).name for g in geoms) + path.name
    driven = sum(not wheel.steer for wheel in wheels) or len(wheels)
    flying = bool(FLYING.search(names))
    motion = CONTROLLED if choice.controller else choice.motion or (WHEELS if driven >= 2 else THRUST if flying else BASE)
    if motion == WHEELS and driven < 2:
        raise ValueError(f"{path}: has {driven} wheels on lateral axles that touch the ground and are driven, needs 2 or more; tell motion=base")
    rest = {model.joint(j).name: float(data.qpos[model.jnt_qposadr[j]]) for j in _hinges(model, root) if model.joint(j).name}
    legs = _legs(model, data, root, float(low[2] + T_root.translation[2])) if motion == BASE else ()
    rolls = motion == WHEELS or (motion == CONTROLLED and driven >= 2)
    told = (_told_place(name, path, scene, T_root) for name in (choice.camera, choice.imu))
    camera, imu = told
    return UserRobot(
        choice, path, spec, model.body(root).name, motion, rest, -float(low[2]), float(high[2]), float(model.body_subtreemass[root]), feet,
        camera, imu or Pose.identity(), motion == THRUST or (motion == CONTROLLED and flying), wheels if rolls else (), legs, drawn,
    )  # fmt: skip


def _is_free(model: Any, body: int) -> bool:
    first = model.body_jntadr[body]
    return bool(first >= 0 and model.jnt_type[first] == int(mujoco.mjtJoint.mjJNT_FREE))


def _drawn_groups(model: Any, geoms: list[int]) -> frozenset[int]:
    """Groups of geoms that are drawn without collisions. Where all geoms collide, the groups that MuJoCo's viewer shows."""
    only = {int(model.geom_group[g]) for g in geoms if not model.geom_contype[g] and not model.geom_conaffinity[g] and model.geom_group[g] < 3}
    return frozenset(only or {0, 1, 2})


def _hinges(model: Any, root: int) -> list[int]:
    kinds = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))
    return [j for j in range(model.njnt) if model.body_rootid[model.jnt_bodyid[j]] == root and int(model.jnt_type[j]) in kinds]


def _wheels(model: Any, data: Any, T_root: Pose, low: float, geoms: list[int]) -> tuple[Wheel, ...]:
    """Hinges without limits and with a lateral axle, whose body touches the ground. Castors, whose vertical hinge has no limits, are no wheels.

    Where three or four wheels with rollers can move the robot in all directions, only these count; their axles may have any horizontal direction.
    """
    out = []
    for joint in range(model.njnt):
        axis = T_root.rotation.T @ data.xaxis[joint]
        body = int(model.jnt_bodyid[joint])
        rollers = _rollers(model, body)
        mine = [g for g in geoms if model.geom_bodyid[g] in (body, *rollers)]
        if not _spins(model, joint) or (abs(axis[2]) > 0.1 if rollers else abs(axis[1]) < 0.95) or not mine:
            continue
        if body in _rollers(model, int(model.body_parentid[body])):
            continue
        upright = [j for j in _hinges(model, int(model.body_rootid[body])) if abs(data.xaxis[j][2]) > 0.9]
        vertical = [j for j in upright if model.jnt_bodyid[j] in (body, model.body_parentid[body])]
        if any(not model.jnt_limited[j] or not model.joint(j).name for j in vertical):
            continue
        centre = T_root.inverse().apply(data.xanchor[joint][None])[0]
        radius = float(centre[2]) - low
        bottom = min(float((geom_triangles(model, data, g) - T_root.translation)[..., 2].min()) for g in mine)
        if model.joint(joint).name and abs(bottom - low) < 0.02 and radius > 0.02:
            wheel = Wheel(model.joint(joint).name, float(centre[0]), float(centre[1]), radius, float(np.sign(axis[1])))
            wheel = wheel if not vertical else _steered(wheel, model, data, vertical[0])
            out.append(wheel if not rollers else _with_rollers(wheel, axis, _lowest_axis(model, data, rollers, geoms) @ T_root.rotation))
    omni = [wheel for wheel in out if wheel.turns]
    if 3 <= len(omni) <= 4 and np.linalg.matrix_rank([wheel.turns for wheel in omni], 0.1) == 3:
        return tuple(omni)
    return tuple(wheel for wheel in out if not wheel.turns)


def _spins(model: Any, joint: int) -> bool:
    """Whether a joint is a hinge without limits."""
    return bool(model.jnt_type[joint] == int(mujoco.mjtJoint.mjJNT_HINGE) and not model.jnt_limited[joint])


def _rollers(model: Any, body: int) -> list[int]:
    """The bodies that spin on a body that itself spins, as rollers do on the rim of a wheel."""
    spinning = {int(model.jnt_bodyid[joint]) for joint in range(model.njnt) if _spins(model, joint)}
    return [b for b in range(1, model.nbody) if model.body_parentid[b] == body and b in spinning] if body in spinning else []


def _lowest_axis(model: Any, data: Any, rollers: list[int], geoms: list[int]) -> Array:
    """Axis (3,) of the roller that touches the ground, world frame."""
    lowest = {b: min(float(geom_triangles(model, data, g)[..., 2].min()) for g in geoms if model.geom_bodyid[g] == b) for b in rollers}
    return np.asarray(data.xaxis[model.body_jntadr[min(lowest, key=lambda body: lowest[body])]])


def _with_rollers(wheel: Wheel, axle: Array, roller: Array) -> Wheel:
    """The wheel with rollers: along the axis of its lowest roller, the rim does not slip on the ground (Muir & Neuman 1987).

    axle, roller: directions (3,), body frame.
    """
    along = wheel.radius * (axle[1] * roller[0] - axle[0] * roller[1])
    if abs(along) < 0.3 * wheel.radius:
        return wheel
    return replace(wheel, turns=tuple((np.array([roller[0], roller[1], wheel.x * roller[1] - wheel.y * roller[0]]) / along).tolist()))


def _steered(wheel: Wheel, model: Any, data: Any, joint: int) -> Wheel:
    """The wheel with the vertical joint that steers it."""
    most = min(abs(float(end)) for end in model.jnt_range[joint])
    return replace(wheel, steer=model.joint(joint).name, steer_sign=float(np.sign(data.xaxis[joint][2])), most_steer=min(most, MOST_STEER))


def _legs(model: Any, data: Any, root: int, ground: float) -> tuple[Leg, ...]:
    """Chains of hinges from the root down to a body on the ground. Hip, knee and ankle are the first three with a lateral axle."""
    legs: list[Leg] = []
    # Feet come first, so that a shin near the ground is not taken for a foot.
    for body in range(model.nbody - 1, 0, -1):
        mine = [g for g in range(model.ngeom) if model.geom_bodyid[g] == body]
        if model.body_rootid[body] != root or not mine:
            continue
        if min(float(geom_triangles(model, data, g)[..., 2].min()) for g in mine) > ground + 0.03:
            continue
        above = body
        chain: list[int] = []
        while above != root:
            first = model.body_jntadr[above]
            chain += range(first, first + model.body_jntnum[above]) if first >= 0 else []
            above = model.body_parentid[above]
        swings = [j for j in chain[::-1] if abs(data.xaxis[j][1]) > 0.8 and model.joint(j).name]
        if len(swings) >= 2 and not any(leg.hip == model.joint(swings[0]).name for leg in legs):
            legs.append(_leg(model, data, swings, body))
    return tuple(legs)


def _leg(model: Any, data: Any, swings: list[int], foot: int) -> Leg:
    """The leg of swinging joints, the hip first; diagonal legs step together."""
    hip, knee = swings[0], swings[1]
    bent = mujoco.MjData(model)
    bent.qpos[:] = data.qpos
    bent.qpos[model.jnt_qposadr[knee]] += 0.3
    mujoco.mj_kinematics(model, bent)
    anchor = data.xanchor[hip]
    shorter = np.linalg.norm(bent.xpos[foot] - anchor) < np.linalg.norm(data.xpos[foot] - anchor)
    x, y = anchor[:2] - data.xpos[model.body_rootid[foot]][:2]
    phase = 0.5 if (y > 0) != (x > 0.05) else 0.0
    sign = np.sign([data.xaxis[joint][1] for joint in swings[:3]]).tolist()
    leg = Leg(model.joint(hip).name, model.joint(knee).name, sign[0], 1.0 if shorter else -1.0, phase)
    if len(swings) == 2:
        return leg
    return replace(leg, ankle=model.joint(swings[2]).name, by_hip=-sign[0] * sign[2], by_knee=-sign[1] * sign[2])


def _told_place(name: str, path: Path, scene: tuple[Any, Any], T_root: Pose) -> Pose | None:
    """Pose in the body frame of the camera or site with this name; None without a name."""
    if not name:
        return None
    model, data = scene
    cameras, sites = ([get(k).name for k in range(n)] for get, n in ((model.camera, model.ncam), (model.site, model.nsite)))
    if name in cameras:
        k = cameras.index(name)
        return T_root.inverse() @ Pose(data.cam_xmat[k].reshape(3, 3) @ CAMERA_AXES, data.cam_xpos[k])
    if name in sites:
        k = sites.index(name)
        return T_root.inverse() @ Pose(data.site_xmat[k].reshape(3, 3), data.site_xpos[k])
    known = ", ".join([name for name in (*cameras, *sites) if name][:12])
    raise ValueError(f"{path}: has no camera or site {name[:40]!r}, has {known or 'none'}")


def wheel_commands(robot: UserRobot, speed: float, yaw_rate: float, measured_yaw_rate: float) -> Array:
    """Commands (n,) of the robot's `servos` for `speed` m/s and `yaw_rate` rad/s, with feedback of the gyroscope's `measured_yaw_rate`.

    Robots with two axles skid in a turn, as in rover.wheel_speeds; those with one axle do not. Steered wheels roll on concentric circles (Ackermann).
    Wheels with rollers do not skid, and need no feedback.
    """
    if robot.wheels[0].turns:
        turns = np.array([wheel.turns for wheel in robot.wheels])
        return np.asarray(turns @ [speed, 0.0, yaw_rate])
    if robot.steered:
        most = 1 / robot.turning_radius
        bend = float(np.clip(np.copysign(yaw_rate, yaw_rate * speed) / max(abs(speed), 0.05), -most, most))
        turned = [w.sign * speed * (1 - bend * w.y) / w.radius for w in robot.driven]
        return np.array([*turned, *(w.steer_sign * np.arctan2(bend * (w.x - robot.axle), 1 - bend * w.y) for w in robot.steered)])
    skid = 2.0 if np.ptp([wheel.x for wheel in robot.wheels]) > 0.1 else 1.0
    turn = skid * yaw_rate + 2.0 * (yaw_rate - measured_yaw_rate)
    return np.array([wheel.sign * (speed - turn * wheel.y) / wheel.radius for wheel in robot.wheels])


def encoder_wheels(robot: UserRobot) -> list[tuple[str, float]]:
    """Joints of four wheels with encoders, each with m per radian. The mean of the four distances is the robot's forward distance.

    In the order of rover.WHEELS: the front and the rear driven wheel of each side. Wheels with rollers have factors by least squares.
    """
    if robot.wheels[0].turns:
        ahead = len(rover.WHEELS) * np.linalg.pinv([wheel.turns for wheel in robot.wheels])[0]
        return [*((w.joint, m) for w, m in zip(robot.wheels, ahead.tolist(), strict=True)), (robot.wheels[0].joint, 0.0)][: len(rover.WHEELS)]
    ordered = sorted(robot.driven, key=lambda wheel: -wheel.x)
    left, right = ([wheel for wheel in ordered if side * wheel.y > 0] or ordered for side in (1, -1))
    return [(wheel.joint, wheel.sign * wheel.radius) for wheel in (left[0], right[0], left[-1], right[-1])]
