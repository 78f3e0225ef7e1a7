"""Run a Scenario: people walk, robots drive, panoramas are taken, and all of it is written down as a Sequence.

Truth, instances and panoramas come from one and the same moment of one MjData: nothing can lag.
"""

from __future__ import annotations

import importlib.metadata
import json
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from sim.panorama import PanoramaRenderer
from sim.scenario import Scenario
from sim.sensing import Detector, true_boxes
from sim.simulation import Simulation
from tracker.cameras import Panorama
from tracker.geometry import Array, Pose
from tracker.ground import Grid
from tracker.measurements import Mount, Setup, Start, Tick, Truth, View
from tracker.sequence import Boxes, SequenceWriter
from worlds.world import World

# What is known of where a robot starts: standard deviations in metres and radians of its right tangent.
START_SIGMA = np.array([0.01, 0.01, 0.01, 0.003, 0.003, 0.005])
# m over the floor: what ends above hides nobody.
HEADROOM = 2.0


@dataclass(frozen=True, eq=False)
class Moment:
    """One frame: the tick that the tracker gets, the truth, and by camera the instances (H, W) uint16 and the true boxes."""

    tick: Tick
    truth: Truth
    instances: dict[str, NDArray[np.uint16]]
    boxes: dict[str, Boxes]


def setup_of(scenario: Scenario, simulation: Simulation) -> Setup:
    """What the tracker is told of a simulation before its first frame; start poses are off by what START_SIGMA says."""
    camera = Panorama(scenario.width, scenario.height)
    ground = simulation.world.ground
    grid = Grid(ground.heights, ground.origin, ground.spacing)
    rng = scenario.stream("starts")
    starts: dict[str, Start | None] = {}
    for robot in simulation.robots:
        error = Pose.exp(rng.normal(0.0, START_SIGMA))
        starts[robot] = Start(simulation.T_world_robot(robot) @ error, np.diag(START_SIGMA**2))
    mounts = {f"{robot}_camera": Mount(camera, simulation.T_body_camera, robot) for robot in simulation.robots}
    return Setup(mounts, grid, starts, scenario.period, occluders=tops(simulation.world))


def tops(world: World) -> Grid:
    """The terrain with what stands on it, as heights on the terrain's own grid, by rays from above.

    What hangs higher than people are tall (beams, lintels) hides nobody and is left out; what they could see under (a table) is not.
    """
    model = world.spec.copy().compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    ground = world.ground
    heights = ground.heights.copy()
    for i, j in np.ndindex(*heights.shape):
        x, y = ground.origin[0] + j * ground.spacing, ground.origin[1] + i * ground.spacing
        heights[i, j] = _top(model, data, x, y, float(heights[i, j]))
    return Grid(heights, ground.origin, ground.spacing)


def _top(model: mujoco.MjModel, data: mujoco.MjData, x: float, y: float, floor: float) -> float:
    """Height of the highest thing over (x, y) that reaches down among people, else of the floor."""
    down, geom, z = np.array([0.0, 0.0, -1.0]), np.zeros(1, np.int32), floor + 50.0
    entered: dict[int, float] = {}
    while True:
        distance = mujoco.mj_ray(model, data, np.array([x, y, z]), down, None, 1, -1, geom, None)
        surface = z - distance
        if distance < 0 or surface <= floor + 0.01:
            # Whatever was entered and not left goes into the ground.
            return max(entered.values(), default=floor)
        if int(geom[0]) not in entered:
            entered[int(geom[0])] = surface
        else:
            top = entered.pop(int(geom[0]))
            if surface < floor + HEADROOM:
                return max(top, *entered.values()) if entered else top
        z = surface - 1e-4


def open_renderer(scenario: Scenario, simulation: Simulation) -> PanoramaRenderer:
    """The renderer for all robots of a simulation; people are its instances. Close it, or use it as a context."""
    return PanoramaRenderer(simulation.model, Panorama(scenario.width, scenario.height), simulation.person_of_geom.astype(np.uint16))


def run(scenario: Scenario, simulation: Simulation, setup: Setup, renderer: PanoramaRenderer) -> Iterator[Moment]:
    """The frames of a scenario, from the first on."""
    detector, streams = Detector.of(scenario), {name: scenario.stream(f"detector/{name}") for name in setup.mounts}
    persons = [int(p) for p in simulation.persons]
    for index in range(scenario.frames):
        if index:
            simulation.step()
        odometry = simulation.odometry() if index else {}
        robots = {robot: simulation.T_world_robot(robot) for robot in simulation.robots}
        poses = [robots[mount.robot] @ mount.T_body_camera for mount in setup.mounts.values()]
        shots = dict(zip(setup.mounts, renderer.render(simulation.data, poses), strict=True))
        alone = dict(zip(setup.mounts, renderer.alone(simulation.data, poses, persons), strict=True))
        boxes = {name: true_boxes(shot.instances, persons, alone[name]) for name, shot in shots.items()}
        views = []
        for name, shot in shots.items():
            mount = setup.mounts[name]
            assert isinstance(mount.camera, Panorama)
            found = detector.detect(mount.camera, boxes[name], scenario.camera_height, streams[name])
            views.append(View(name, found, odometry=odometry.get(mount.robot), image=shot.colour))
        truth = Truth(index, robots, np.array(persons, dtype=np.int64), simulation.feet(), _fractions(persons, list(boxes.values())))
        instances = {name: shot.instances for name, shot in shots.items()}
        yield Moment(Tick(index, index * scenario.period, tuple(views)), truth, instances, boxes)


def _fractions(persons: list[int], boxes: list[Boxes]) -> Array:
    """Visible fraction (m, cameras) of every person; 0 where a camera would not show the person at all."""
    out = np.zeros((len(persons), len(boxes)))
    row = {person: k for k, person in enumerate(persons)}
    for c, view in enumerate(boxes):
        for person, visible in zip(view.person, view.visible, strict=True):
            out[row[int(person)], c] = visible
    return out


def record(scenario: Scenario, folder: Path, progress: Any = None) -> None:
    """Write the Sequence of a scenario into `folder`, which must not be there yet; nothing is left where it fails.

    progress: wraps the iterator of frames (tqdm, say), or None. Raises ValueError for a scenario that its world cannot hold.
    """
    if folder.exists():
        raise ValueError(f"{folder}: is there already")
    simulation = Simulation(scenario)
    setup = setup_of(scenario, simulation)
    occluders = setup.occluders
    assert isinstance(occluders, Grid)
    with open_renderer(scenario, simulation) as renderer, SequenceWriter(folder, setup, occluders) as writer:
        moments: Iterable[Moment] = run(scenario, simulation, setup, renderer)
        for moment in progress(moments, total=scenario.frames) if progress else moments:
            writer.add(moment.tick, moment.truth, moment.instances, moment.boxes)
        writer.finish(json.loads(scenario.to_json()), versions())


def versions() -> dict[str, str]:
    """Versions of what decides the bytes of a sequence."""
    return {name: importlib.metadata.version(name) for name in ("pilsim", "mujoco", "numpy", "scipy", "opencv-python-headless")}
