"""Run a Scenario: people walk, robots drive, panoramas are taken, and all of it is written down as a Sequence.

Truth, instances and panoramas come from one and the same moment of one MjData: nothing can lag.
"""

from __future__ import annotations

import importlib
import json
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.recording.tracker_setup import Fixed, setup_of
from sim.rendering.panorama import PanoramaRenderer, RenderedImage
from sim.rendering.semantic_labels import classes
from sim.scenario import Scenario
from sim.sensors.exposure import Exposure
from sim.sensors.keypoints import Sight
from sim.sensors.person_detector import Detector, People, true_view
from sim.sensors.robot_detector import RobotDetector
from sim.simulation.simulation import Simulation
from tracker.geometry import Array, Ints, Pose
from tracker.geometry.cameras import Camera, Panorama
from tracker.geometry.ground import Grid
from tracker.sequence.writer import ImageForm, Layers, SequenceWriter
from tracker.types import Setup, Tick, Truth, View, ViewTruth
from worlds.export import export


@dataclass(frozen=True, eq=False)
class RenderedFrame:
    """One frame: the tick that the tracker gets, the truth, and by camera the instances (H, W) uint16, what is true of the view, range (H, W) m
    along the ray, inf where nothing is, and classes (H, W) uint8 of worlds.semantics."""

    tick: Tick
    truth: Truth
    instances: dict[str, NDArray[np.uint16]]
    views: dict[str, ViewTruth]
    range: dict[str, NDArray[np.float32]]
    classes: dict[str, NDArray[np.uint8]]


def open_renderer(scenario: Scenario, simulation: Simulation, others: Iterable[Camera] = ()) -> PanoramaRenderer:
    """The renderer for all robots of a simulation, and for other cameras; people are its instances. Close it, or use it as a context."""
    cameras = [Panorama(scenario.width, scenario.height), *others]
    return PanoramaRenderer(simulation.model, cameras, simulation.person_of_geom.astype(np.uint16), classes(simulation.model))


def run(scenario: Scenario, simulation: Simulation, setup: Setup, renderer: PanoramaRenderer) -> Iterator[RenderedFrame]:
    """The frames of a scenario, from the first on. The renderer must have been opened with every camera of the setup."""
    detector, streams = Detector.of(scenario), {name: scenario.stream(f"detector/{name}") for name in setup.mounts}
    spotter = RobotDetector(scenario, setup, simulation)
    drifts = {name: Exposure(scenario.exposure, scenario.image_noise, scenario.period, scenario.stream(f"exposure/{name}")) for name in setup.mounts}
    for index in range(scenario.frames):
        if index:
            simulation.step()
        odometry = simulation.odometry() if index else {}
        robots = poses_of(simulation, setup)
        people = People(np.asarray(simulation.persons, dtype=np.int64), simulation.joints())
        sights, shots, true = _look(simulation, setup, renderer, people)
        views = []
        for name, mount in setup.mounts.items():
            found = detector.detect(mount.camera, true[name], streams[name])
            image = drifts[name].take(shots[name].colour)
            views.append(View(name, found, odometry=odometry.get(mount.robot), image=image, robot_detections=spotter.spot(name)))
        tipped = frozenset(robot for robot, over in simulation.tipped().items() if over)
        truth = Truth(index, robots, people.person, simulation.feet(), fractions_of(people.person, true), people.joints, tipped)
        instances = {name: sight.instances for name, sight in sights.items()}
        ranges = {name: sight.range for name, sight in sights.items()}
        kinds = {name: shot.classes for name, shot in shots.items() if shot.classes is not None}
        yield RenderedFrame(Tick(index, index * scenario.period, tuple(views)), truth, instances, true, ranges, kinds)


def poses_of(simulation: Simulation, setup: Setup) -> dict[str, Pose]:
    """T_world_robot of all robots; those that the simulation does not drive stand where they started."""
    out = {}
    for robot, start in setup.starts.items():
        if robot in simulation.robots:
            out[robot] = simulation.T_world_robot(robot)
        else:
            assert start is not None
            out[robot] = start.T_world_robot
    return out


def _look(
    simulation: Simulation, setup: Setup, renderer: PanoramaRenderer, people: People
) -> tuple[dict[str, Sight], dict[str, RenderedImage], dict[str, ViewTruth]]:
    """By camera, all of one moment: what it shows, with colours and classes, and what is true of it."""
    robots = poses_of(simulation, setup)
    poses = [robots[mount.robot] @ mount.T_body_camera for mount in setup.mounts.values()]
    which = [renderer.cameras.index(mount.camera) for mount in setup.mounts.values()]
    shots = renderer.render(simulation.data, poses, which)
    unoccluded = renderer.unoccluded(simulation.data, poses, people.person.tolist(), which)
    sights, true = {}, {}
    for name, shot, pose, bodies in zip(setup.mounts, shots, poses, unoccluded, strict=True):
        sights[name] = Sight(setup.mounts[name].camera, pose, shot.instances, shot.range)
        true[name] = true_view(sights[name], people, bodies, simulation.world)
    return sights, dict(zip(setup.mounts, shots, strict=True)), true


def fractions_of(persons: Ints, views: Mapping[str, ViewTruth]) -> Array:
    """Visible fraction (m, cameras) of every person; 0 where a camera would not show the person at all."""
    out = np.zeros((len(persons), len(views)))
    row = {person: k for k, person in enumerate(persons.tolist())}
    for c, view in enumerate(views.values()):
        for person, visible in zip(view.boxes.person.tolist(), view.boxes.visible, strict=True):
            out[row[person], c] = visible
    return out


@dataclass(frozen=True, eq=False)
class Stage:
    """What is recorded: a simulation at its first frame, cameras beside those of its rovers, all that made them, as JSON values,
    and what is written."""

    scenario: Scenario
    simulation: Simulation
    fixed: Mapping[str, Fixed]
    provenance: dict[str, Any]
    form: ImageForm = field(default_factory=ImageForm)

    @staticmethod
    def of(scenario: Scenario) -> Stage:
        return Stage(scenario, Simulation(scenario), {}, json.loads(scenario.to_json()))


def record(scenario: Scenario, folder: Path, progress: Any = None) -> None:
    """Write the Sequence of a scenario into `folder`, which must not be there yet; nothing is left where it fails.

    progress: wraps the iterator of frames (tqdm, say), or None. Raises ValueError for a scenario that its world cannot hold.
    """
    check_free(folder)
    record_stage(Stage.of(scenario), folder, progress)


def check_free(folder: Path) -> None:
    """Raises ValueError where there is something of that name."""
    if folder.exists():
        raise ValueError(f"{folder}: is there already")


def record_stage(stage: Stage, folder: Path, progress: Any = None) -> None:
    """As `record`, of a stage."""
    check_free(folder)
    scenario, simulation = stage.scenario, stage.simulation
    setup = setup_of(scenario, simulation, stage.fixed)
    occluders = setup.occluders
    assert isinstance(occluders, Grid)
    others = dict.fromkeys(one.camera for one in stage.fixed.values())
    with open_renderer(scenario, simulation, others) as renderer, SequenceWriter(folder, setup, occluders, stage.form) as writer:
        if stage.form.mesh:
            export(simulation.world, writer.partial / "terrain.glb")
        moments: Iterable[RenderedFrame] = run(scenario, simulation, setup, renderer)
        for moment in progress(moments, total=scenario.frames) if progress else moments:
            writer.add(moment.tick, moment.truth, Layers(moment.instances, moment.range, moment.classes), moment.views)
        writer.finish(stage.provenance, versions())


def versions() -> dict[str, str]:
    """Versions of what decides the bytes of a sequence."""
    return {name: importlib.metadata.version(name) for name in ("pilsim", "mujoco", "numpy", "scipy", "opencv-python-headless")}
