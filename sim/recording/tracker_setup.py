"""The setup that the tracker gets before the first frame of a simulation, with true or erroneous camera mounts."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from sim.cameras import Rig, RigView
from sim.pedestrian import skeleton
from sim.recording.frames import clocks_of
from sim.recording.shots import MountedRig, mounted_rigs, rig_of
from sim.scenario import Scenario
from sim.sensors.raycast_camera import Raycaster
from sim.simulation.simulation import Simulation
from tracker.geometry import Mask, Pose
from tracker.geometry.cameras import Panorama, pinhole
from tracker.geometry.ground import Grid
from tracker.recordings import RecordingCamera
from tracker.types import Mount, Setup, Start
from worlds.world import World

# Standard deviations of the known start pose of a robot, in metres and radians of its right tangent.
START_SIGMA = np.array([0.01, 0.01, 0.01, 0.003, 0.003, 0.005])

OWN_BODY_CELLS, OWN_BODY_REACH = (120, 60), 3.0
"""Columns and rows of the mask of a robot's own body, and the range within which it is searched, m."""


def _exposed(scenario: Scenario, rig: Rig, view: RigView) -> tuple[float, float]:
    """s from the first row to the last, and s of exposure. The first is 0 for a stitched panorama, whose rows are not those of its sensors."""
    stitched, effects = rig.stitching is not None and not view.suffix, scenario.camera_effects
    return 0.0 if stitched else effects.readout or 0.0, effects.shutter or 0.0


def cameras_of(world: World, width: int) -> dict[str, RecordingCamera]:
    """The cameras of a user's MJCF as fixed cameras View_001 …, with pictures `width` px wide, three quarters as high."""
    height = 2 * round(0.375 * width)
    lenses = (pinhole(width, height, 2 * math.atan(math.tan(one.view / 2) * width / height)) for one in world.cameras)
    poses = (Pose(one.rotation, one.position) for one in world.cameras)
    return {f"View_{k + 1:03d}": RecordingCamera(lens, pose) for k, (lens, pose) in enumerate(zip(lenses, poses, strict=True))}


def make_setup(simulation: Simulation, fixed: Mapping[str, RecordingCamera] | None = None) -> Setup:
    """The setup of a simulation at its first frame. Start poses of rovers have random errors with sigma START_SIGMA.

    fixed: name → camera, in addition to those of the rovers. The tracker treats it as a robot that stays at its known pose.
    Raises ValueError where there is no camera at all.
    """
    scenario = simulation.scenario
    scenario.check_any_camera(len(fixed or {}))
    rig = rig_of(scenario.camera, scenario.width)
    rng = scenario.stream("starts")
    starts: dict[str, Start | None] = {}
    for robot in simulation.robots:
        error = Pose.exp(rng.normal(0.0, START_SIGMA))
        starts[robot] = Start(simulation.T_world_robot(robot) @ error, np.diag(START_SIGMA**2))
    mounts = {
        f"{robot}_camera{view.suffix}": Mount(view.camera, simulation.mount(robot) @ view.T_rig_view, robot, *_exposed(scenario, rig, view))
        for robot in simulation.robots
        for view in rig.views
    }
    mounts = {name: replace(mount, own_body=_own_body(simulation, mount)) for name, mount in mounts.items()}
    for name, one in (fixed or {}).items():
        starts[name] = Start(one.pose, np.zeros((6, 6)))
        if scenario.view_camera:
            views = rig_of(scenario.view_camera, scenario.view_width).views
            mounts |= {f"{name}{view.suffix}": Mount(view.camera, view.T_rig_view, name) for view in views}
        else:
            mounts[name] = Mount(one.camera, Pose.identity(), name)
    # The walkable surface, with decks of bridges, on the grid of the ground.
    floor = simulation.world.terrain.on_grid
    terrain, occluders = (Grid(field.heights, field.origin, field.spacing) for field in (floor, simulation.world.tops()))
    band = Setup.height if not scenario.children else (Setup.height[0] - (skeleton.ADULTS[0] - skeleton.CHILDREN[0]), Setup.height[1])
    setup = Setup(mounts, terrain, starts, scenario.period, height=band, occluders=occluders)
    slower = {name: replace(mounts[name], period=1 / clock.rate) for name, clock in clocks_of(scenario, setup).items() if clock.rate}
    return replace(setup, mounts=mounts | slower)


def _own_body(simulation: Simulation, mount: Mount) -> Mask | None:
    """Where a camera sees its robot at rest; None for rovers, whose bodies are below all lines of sight to people."""
    if not simulation.is_of_user(mount.robot):
        return None
    eye, lens = simulation.T_world_robot(mount.robot) @ mount.T_body_camera, Panorama(*OWN_BODY_CELLS)
    row, column = np.indices(OWN_BODY_CELLS[::-1])
    bearings = lens.bearings_from_pixels(np.stack([column.ravel(), row.ravel()], axis=1) + 0.5)
    geom, _ = Raycaster(simulation).first_hit(eye.translation, eye.translation + OWN_BODY_REACH * bearings @ eye.rotation.T)
    mine = (geom >= 0) & (simulation.robot_of_geom[geom] == 1 + simulation.robots.index(mount.robot))
    return np.asarray(mine.reshape(OWN_BODY_CELLS[::-1])) if mine.any() else None


def told_setup(simulation: Simulation, true: Setup) -> Setup:
    """The setup given to the tracker: every rig is turned by mount_angle about a random axis, and moved by mount_shift in a random direction.

    The lenses of a rig move together. Axis and direction come from the stream "calibration/NAME". Without these effects it is the true setup.
    """
    scenario = simulation.scenario
    effects = scenario.camera_effects
    if effects.mount_angle is None and effects.mount_shift is None:
        return true
    mounts = dict(true.mounts)
    for mounted in mounted_rigs(simulation, true):
        error = _mount_error(scenario, mounted)
        for view in mounted.rig.views:
            name = mounted.name + view.suffix
            mounts[name] = replace(mounts[name], T_body_camera=mounted.T_body_rig @ error @ view.T_rig_view)
    return replace(true, mounts=mounts)


def _mount_error(scenario: Scenario, mounted: MountedRig) -> Pose:
    effects, rng = scenario.camera_effects, scenario.stream(f"calibration/{mounted.name}")
    axis, direction = (vector / np.linalg.norm(vector) for vector in rng.normal(size=(2, 3)))
    shift, turn = (effects.mount_shift or 0.0) * direction, math.radians(effects.mount_angle or 0.0) * axis
    return Pose(Pose.exp(np.concatenate([np.zeros(3), turn])).rotation, shift)
