"""The rover as MuJoCo bodies: a low chassis on four driven wheels with skid steering, and a thin mast with the panoramic camera.

The origin of the body frame is the centre of the wheel base at the height of the axles: x forward, y left, z up.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from tracker.geometry import Array, Pose
from worlds.engine import mujoco

WHEEL_RADIUS = 0.12
"""m: wheels collide as spheres and are drawn as cylinders."""
BASE = 0.50
"""m between front and rear axles."""
TRACK = 0.56
"""m between the left and the right wheels."""
FOOTPRINT_RADIUS = 0.50
"""m: radius of the circle about the body's origin that contains the rover."""
HALF_WIDTH = 0.45
"""m: radius that other rovers avoid; between half the width and the radius of the turning circle."""
WHEELS = ("front_left", "front_right", "rear_left", "rear_right")
"""Order of all wheel arrays: even is left, odd is right."""
SPRUNG_MASS = 17.5
"""kg: hull, trim and mast."""
SAG, TRAVEL = 0.015, 0.03
"""m: deflection of the springs under the weight of the rover, and travel up and down from there."""
HEAD_GAP = 0.08
"""m: distance from the top of the head up to the panorama's centre, so that nothing encloses the camera."""

_GROUP = 3
_DRAWN: dict[str, Any] = {"contype": 0, "conaffinity": 0, "group": _GROUP}
"""Attributes of geoms that are drawn and collide with nothing."""
_COLLIDES: dict[str, Any] = {"contype": 1, "conaffinity": 3}
"""Attributes of geoms that collide with the world, with rovers and with people."""
_UNSEEN: dict[str, Any] = _COLLIDES | {"group": 4, "rgba": (0, 0, 0, 0)}
"""Attributes of geoms that collide in place of drawn geoms."""
_METAL, _RUBBER, _LENS = (0.62, 0.64, 0.66, 1.0), (0.08, 0.08, 0.09, 1.0), (0.05, 0.06, 0.09, 1.0)
_PAINTS = ((0.93, 0.45, 0.10, 1.0), (0.12, 0.42, 0.75, 1.0), (0.20, 0.55, 0.25, 1.0), (0.80, 0.75, 0.15, 1.0), (0.62, 0.16, 0.18, 1.0))


def wheel_positions() -> Array:
    """Wheel centres (4, 3) m in the body frame, in the order of WHEELS."""
    x, y = BASE / 2, TRACK / 2
    return np.array([[x, y, 0.0], [x, -y, 0.0], [-x, y, 0.0], [-x, -y, 0.0]])


def camera_mount(camera_height: float) -> Pose:
    """T_body_camera of the panorama, whose centre is `camera_height` m above level ground; x forward."""
    return Pose(np.eye(3), np.array([0.0, 0.0, camera_height - WHEEL_RADIUS]))


def add_rover(spec: mujoco.MjSpec, name: str, index: int, camera_height: float) -> None:
    """Add one rover of about 24 kg to the world body of `spec`: bodies, joints and actuators are named `name` or `name/…`.

    Actuators `name/front_left` … take wheel speeds in rad/s. Rovers collide with the world, with each other and with people.
    """
    chassis = spec.worldbody.add_body(name=name)
    chassis.add_freejoint(name=name)
    paint = _PAINTS[index % len(_PAINTS)]
    hull = {"type": mujoco.mjtGeom.mjGEOM_BOX, "size": (0.33, 0.19, 0.055), "pos": (0, 0, 0.035)}
    chassis.add_geom(name=f"{name}/hull", mass=15.0, group=_GROUP, rgba=paint, **hull, **_COLLIDES)
    _add_trim(chassis, name, paint)
    add_mast(chassis, name, camera_height - WHEEL_RADIUS)
    for wheel, position in zip(WHEELS, wheel_positions(), strict=True):
        _add_wheel(spec, chassis, f"{name}/{wheel}", position)


def _add_trim(chassis: mujoco.MjsBody, name: str, paint: tuple[float, ...]) -> None:
    """Visual parts of the chassis: deck, bumpers, lamps."""
    parts = {
        "deck": ((0.24, 0.15, 0.03), (-0.03, 0, 0.12), _METAL),
        "battery": ((0.09, 0.12, 0.035), (-0.16, 0, 0.185), paint),
        "front_bumper": ((0.02, 0.17, 0.02), (0.35, 0, 0.03), _RUBBER),
        "rear_bumper": ((0.02, 0.17, 0.02), (-0.35, 0, 0.03), _RUBBER),
        "left_lamp": ((0.012, 0.03, 0.02), (0.33, 0.11, 0.075), (0.98, 0.97, 0.85, 1.0)),
        "right_lamp": ((0.012, 0.03, 0.02), (0.33, -0.11, 0.075), (0.98, 0.97, 0.85, 1.0)),
    }
    for part, (size, position, colour) in parts.items():
        chassis.add_geom(name=f"{name}/{part}", type=mujoco.mjtGeom.mjGEOM_BOX, size=size, pos=position, rgba=colour, mass=0.3, **_DRAWN)


def add_mast(chassis: mujoco.MjsBody, name: str, centre: float, foot: float = 0.1) -> None:
    """The mast and the head, whose top is HEAD_GAP below the panorama's centre at z = `centre`, body frame. foot: z of the mast's lower end, m."""
    top = max(centre - HEAD_GAP, foot + 0.08)
    capsule, cylinder = mujoco.mjtGeom.mjGEOM_CAPSULE, mujoco.mjtGeom.mjGEOM_CYLINDER
    rod = (0, 0, foot, 0, 0, top - 0.06)
    chassis.add_geom(name=f"{name}/mast", type=capsule, size=(0.014, 0, 0), fromto=rod, rgba=_METAL, mass=0.5, **_DRAWN)
    chassis.add_geom(name=f"{name}/head", type=cylinder, size=(0.018, 0.02, 0), pos=(0, 0, top - 0.06), rgba=_METAL, mass=0.15, **_DRAWN)
    chassis.add_geom(name=f"{name}/lens", type=cylinder, size=(0.009, 0.02, 0), pos=(0, 0, top - 0.02), rgba=_LENS, mass=0.05, **_DRAWN)
    # The mast is thin. An invisible thicker rod collides in its place.
    guard = (0, 0, foot + 0.1, 0, 0, top - 0.06)
    chassis.add_geom(name=f"{name}/mast_guard", type=capsule, size=(0.05, 0, 0), fromto=guard, mass=0.0, **_UNSEEN)


def _add_wheel(spec: mujoco.MjSpec, chassis: mujoco.MjsBody, name: str, position: Array) -> None:
    """A driven wheel on a vertical spring, which carries a quarter of the weight at mid-travel. All wheels thus touch uneven ground."""
    wheel = chassis.add_body(name=name, pos=position)
    load = 9.81 * SPRUNG_MASS / 4
    wheel.add_joint(
        name=f"{name}_spring",
        type=mujoco.mjtJoint.mjJNT_SLIDE,
        axis=(0, 0, 1),
        stiffness=load / SAG,
        springref=-SAG,
        damping=2 * 0.7 * math.sqrt(load / SAG * SPRUNG_MASS / 4),
        limited=mujoco.mjtLimited.mjLIMITED_TRUE,
        range=(-TRAVEL, TRAVEL),
    )
    wheel.add_joint(name=name, type=mujoco.mjtJoint.mjJNT_HINGE, axis=(0, 1, 0), armature=0.02, damping=0.05)
    upright = (math.sqrt(0.5), math.sqrt(0.5), 0.0, 0.0)
    wheel.add_geom(
        name=f"{name}_tread",
        type=mujoco.mjtGeom.mjGEOM_SPHERE,
        size=(WHEEL_RADIUS, 0, 0),
        mass=1.4,
        condim=3,
        friction=(0.9, 0.005, 0.0001),
        priority=1,
        solref=(0.02, 1.0),
        **_UNSEEN,
    )
    attributes = _DRAWN | {"mass": 0.05, "quat": upright}
    wheel.add_geom(name=f"{name}_tyre", type=mujoco.mjtGeom.mjGEOM_CYLINDER, size=(WHEEL_RADIUS, 0.04, 0), rgba=_RUBBER, **attributes)
    wheel.add_geom(name=f"{name}_rim", type=mujoco.mjtGeom.mjGEOM_CYLINDER, size=(0.07, 0.045, 0), rgba=_METAL, **attributes)
    actuator = spec.add_actuator(name=name, trntype=mujoco.mjtTrn.mjTRN_JOINT, target=name)
    actuator.set_to_velocity(kv=8.0)
    actuator.forcelimited, actuator.forcerange = mujoco.mjtLimited.mjLIMITED_TRUE, (-9.0, 9.0)


def wheel_speeds(speed: float, yaw_rate: float, measured_yaw_rate: float) -> Array:
    """Wheel commands (4,) rad/s in the order of WHEELS for `speed` m/s and `yaw_rate` rad/s.

    Skidding reduces the rotation of the body, as if the track were wider (Mandow et al. 2007).
    Feedback of `measured_yaw_rate` rad/s from the gyroscope corrects the rest.
    """
    turn = 0.5 * TRACK * (2.0 * yaw_rate + 2.0 * (yaw_rate - measured_yaw_rate))
    left, right = (speed - turn) / WHEEL_RADIUS, (speed + turn) / WHEEL_RADIUS
    return np.array([left, right, left, right])
