"""Robots that tests write: on wheels of several kinds, and in the air."""

from __future__ import annotations

from pathlib import Path

import numpy as np

WHEEL = """<body name="{name}" pos="{x} {y} 0.1">{steer}<joint name="{name}" type="hinge" axis="0 1 0" damping="0.01"/>
<geom type="cylinder" size="0.1 0.03" quat="0.7071 0.7071 0 0" mass="0.6" friction="0.9 0.01 0.001"/></body>"""
CASTER = '<geom name="caster" type="sphere" size="0.05" pos="-0.2 0 0.05" friction="0.01 0.01 0.01" priority="1" mass="0.3"/>'
HULL = '<geom name="hull" type="box" size="0.22 0.15 0.05" pos="0 0 0.15" mass="8" rgba="0.2 0.5 0.8 1"/>'


def rolling(path: Path, wheels: list[tuple[str, float, float]], extra: str = "", steered: tuple[str, ...] = ()) -> str:
    """An MJCF of a hull on wheels: name, x and y m of each. steered: wheels below a vertical hinge."""
    turn = '<joint name="steer_{}" type="hinge" axis="0 0 1" range="-35 35" limited="true"/>'
    bodies = "".join(WHEEL.format(name=n, x=x, y=y, steer=turn.format(n) if n in steered else "") for n, x, y in wheels)
    site = '<site name="eye" pos="0.1 0 0.6"/>'
    path.write_text(f'<mujoco model="cart"><worldbody><body name="cart"><freejoint/>{HULL}{site}{extra}{bodies}</body></worldbody></mujoco>')
    return str(path)


def differential(folder: Path) -> str:
    """Two wheels and a caster."""
    return rolling(folder / "differential.xml", [("left", 0.15, 0.2), ("right", 0.15, -0.2)], CASTER)


def self_controlled(folder: Path, controller: str) -> str:
    """The cart with motors of its own, which a controller sets, and its choice."""
    motors = '<actuator><velocity joint="left" kv="3"/><velocity name="right" joint="right" kv="3"/></actuator></mujoco>'
    path = folder / "own.xml"
    path.write_text(Path(differential(folder)).read_text().replace("</mujoco>", motors))
    return f"{path}:controller={controller}"


def tower(folder: Path) -> str:
    """Two wheels, a camera at 1.2 m before a tower that is higher, and a site for an IMU, turned by a quarter."""
    extra = (
        CASTER
        + """<geom name="tower" type="box" size="0.05 0.2 0.8" pos="-0.1 0 0.9" mass="1"/><site name="head" pos="0.1 0 1.2"/>
<site name="imu" pos="0.1 0.05 0.3" euler="0 0 90"/>"""
    )
    return rolling(folder / "tower.xml", [("left", 0.0, 0.2), ("right", 0.0, -0.2)], extra)


def skid_steer(folder: Path) -> str:
    """Four driven wheels on fixed axles."""
    return rolling(folder / "skid.xml", [("fl", 0.2, 0.2), ("fr", 0.2, -0.2), ("rl", -0.2, 0.2), ("rr", -0.2, -0.2)])


def ackermann(folder: Path) -> str:
    """Two driven wheels, and two that are steered."""
    wheels = [("fl", 0.2, 0.2), ("fr", 0.2, -0.2), ("rl", -0.2, 0.2), ("rr", -0.2, -0.2)]
    return rolling(folder / "ackermann.xml", wheels, steered=("fl", "fr"))


def _on_rollers(path: Path, wheels: list[tuple[float, float, float, float]]) -> str:
    """A hull on wheels with twelve barrels on each rim: x, y m, direction of the axle, and angle of the barrels to the rim, degrees."""
    roller = """<body pos="{x:.4f} 0 {z:.4f}" euler="{tilt}"><joint type="hinge" axis="1 0 0" damping="0.0001"/>
<geom type="ellipsoid" size="{long:.4f} 0.02 0.02" mass="0.02" friction="0.9 0.01 0.001" conaffinity="0"/></body>"""
    bodies = ""
    for k, (x, y, turn, skew) in enumerate(wheels):
        # So long that their curve is that of the rim.
        long, around = np.sqrt(0.1 * 0.02) / np.cos(np.radians(skew)), np.arange(12) * np.pi / 6
        rim = "".join(roller.format(x=0.08 * np.sin(a), z=0.08 * np.cos(a), tilt=f"0 {np.degrees(a):.1f} {skew}", long=long) for a in around)
        core = f'<joint name="w{k}" type="hinge" axis="0 1 0" damping="0.01"/><geom type="cylinder" size="0.05 0.02" euler="90 0 0" mass="0.4"/>'
        bodies += f'<body name="w{k}" pos="{x:.4f} {y:.4f} 0.1" euler="0 0 {turn}">{core}{rim}</body>'
    path.write_text(f'<mujoco><worldbody><body name="cart"><freejoint/>{HULL}{bodies}</body></worldbody></mujoco>')
    return str(path)


def kiwi(folder: Path) -> str:
    """Three omnidirectional wheels, at 60°, 180° and 300°."""
    at = [(0.3 * np.cos(np.radians(a)), 0.3 * np.sin(np.radians(a)), a - 90.0, 0.0) for a in (60.0, 180.0, 300.0)]
    return _on_rollers(folder / "kiwi.xml", at)


def mecanum(folder: Path) -> str:
    """Four wheels with rollers at 45°."""
    return _on_rollers(folder / "mecanum.xml", [(x, y, 0.0, 45.0 * np.sign(x * y)) for x in (0.2, -0.2) for y in (0.2, -0.2)])


def walker(folder: Path) -> str:
    """Four legs of two joints, as high as a dog."""
    leg = """<body name="{0}_thigh" pos="{1} {2} 0"><joint name="{0}_hip" axis="0 1 0" range="-1 1" limited="true"/>
    <geom type="capsule" fromto="0 0 0 0 0 -0.2" size="0.03" mass="0.4"/>
    <body name="{0}_shank" pos="0 0 -0.2"><joint name="{0}_knee" axis="0 1 0" range="-2 2" limited="true"/>
    <geom type="capsule" fromto="0 0 0 0 0 -0.18" size="0.02" mass="0.2"/></body></body>"""
    legs = "".join(leg.format(n, x, y) for n, x, y in (("fl", 0.2, 0.1), ("fr", 0.2, -0.1), ("rl", -0.2, 0.1), ("rr", -0.2, -0.1)))
    body = f'<body name="trunk" pos="0 0 0.4"><freejoint/><geom type="box" size="0.25 0.1 0.06" mass="6"/>{legs}</body>'
    (folder / "walker.xml").write_text(f"<mujoco><worldbody>{body}</worldbody></mujoco>")
    return str(folder / "walker.xml")


def biped(folder: Path) -> str:
    """Two legs with hips, knees and ankles."""
    joint = '<joint name="{0}_{1}" axis="0 {2} 0" range="-90 90" limited="true"/>'
    bone = '<geom type="capsule" fromto="0 0 0 0 0 -0.35" size="0.04"/>'
    foot = f'<body name="{{0}}_foot" pos="0 0 -0.4">{joint.format("{0}", "ankle", -1)}<geom type="box" size="0.1 0.04 0.02"/></body>'
    shank = f'<body name="{{0}}_shank" pos="0 0 -0.4">{joint.format("{0}", "knee", 1)}{bone}{foot}</body>'
    leg = f'<body name="{{0}}_thigh" pos="0 {{1}} 0">{joint.format("{0}", "hip", 1)}{bone}{shank}</body>'
    trunk = f'<geom type="box" size="0.1 0.15 0.2" pos="0 0 0.2"/>{leg.format("l", 0.1)}{leg.format("r", -0.1)}'
    body = f'<body name="trunk" pos="0 0 0.82">{trunk}</body>'
    (folder / "biped.xml").write_text(f"<mujoco><worldbody>{body}</worldbody></mujoco>")
    return str(folder / "biped.xml")


def quadrotor(folder: Path) -> str:
    """A body with four rotors, whose centre of mass is off its origin."""
    rotors = "".join(f'<geom name="rotor{k}" type="cylinder" size="0.1 0.005" pos="{x} {y} 0.03" mass="0.05"/>' for k, (x, y) in
                     enumerate(((0.15, 0.15), (0.15, -0.15), (-0.15, 0.15), (-0.15, -0.15))))  # fmt: skip
    core = f'<body name="drone"><freejoint/><geom type="box" size="0.08 0.05 0.03" pos="0.02 0 0" mass="0.8"/>{rotors}</body>'
    (folder / "quadrotor.xml").write_text(f"<mujoco><worldbody>{core}</worldbody></mujoco>")
    return str(folder / "quadrotor.xml")
