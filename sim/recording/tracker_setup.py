"""What the tracker is told about a simulation before the first frame."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from sim.pedestrian import skeleton
from sim.scenario import Scenario
from sim.simulation.simulation import Simulation
from tracker.geometry import Pose
from tracker.geometry.cameras import Camera, Panorama
from tracker.geometry.ground import Grid
from tracker.types import Mount, Setup, Start
from worlds.world import tops

# What is known of where a robot starts: standard deviations in metres and radians of its right tangent.
START_SIGMA = np.array([0.01, 0.01, 0.01, 0.003, 0.003, 0.005])


@dataclass(frozen=True)
class FixedCamera:
    """A camera that stands still: to the tracker, a robot that never moves and is known to be at T_world_camera."""

    camera: Camera
    T_world_camera: Pose


def make_setup(scenario: Scenario, simulation: Simulation, fixed: Mapping[str, FixedCamera] | None = None) -> Setup:
    """What the tracker is told of a simulation before its first frame; start poses of rovers are off by what START_SIGMA says.

    fixed: name → camera, beside those of the rovers.
    """
    camera = Panorama(scenario.width, scenario.height)
    rng = scenario.stream("starts")
    starts: dict[str, Start | None] = {}
    for robot in simulation.robots:
        error = Pose.exp(rng.normal(0.0, START_SIGMA))
        starts[robot] = Start(simulation.T_world_robot(robot) @ error, np.diag(START_SIGMA**2))
    mounts = {f"{robot}_camera": Mount(camera, simulation.T_body_camera, robot) for robot in simulation.robots}
    for name, one in (fixed or {}).items():
        mounts[name], starts[name] = Mount(one.camera, Pose.identity(), name), Start(one.T_world_camera, np.zeros((6, 6)))
    # What is walked on, decks of bridges among it, on the grid of the ground.
    floor = simulation.world.terrain.on_grid
    terrain, occluders = (Grid(field.heights, field.origin, field.spacing) for field in (floor, tops(simulation.world)))
    band = Setup.height if not scenario.children else (Setup.height[0] - (skeleton.ADULTS[0] - skeleton.CHILDREN[0]), Setup.height[1])
    return Setup(mounts, terrain, starts, scenario.period, height=band, occluders=occluders)
