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

from sim.recording.tracker_setup import FixedCamera, make_setup
from sim.rendering.panorama import PanoramaRenderer, RenderedImage
from sim.rendering.semantic_labels import classes
from sim.scenario import Scenario
from sim.sensors.exposure import Exposure
from sim.sensors.keypoints import InstanceImage
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
    robot_detector = RobotDetector(scenario, setup, simulation)
    exposures = {name: Exposure(scenario.exposure, scenario.image_noise, scenario.period, scenario.stream(f"exposure/{name}")) for name in setup.mounts}
    for index in range(scenario.frames):
        if index:
            simulation.step()
        odometry = simulation.odometry() if index else {}
        robots = robot_poses(simulation, setup)
        people = People(np.asarray(simulation.persons, dtype=np.int64), simulation.joints())
        images_of_instances, shots, true = _look(simulation, setup, renderer, people)
        views = []
        for name, mount in setup.mounts.items():
            found = detector.detect(mount.camera, true[name], streams[name])
            image = exposures[name].apply(shots[name].colour)
            views.append(View(name, found, odometry=odometry.get(mount.robot), image=image, robot_detections=robot_detector.detect(name)))
        tipped = frozenset(robot for robot, over in simulation.tipped().items() if over)
        truth = Truth(index, robots, people.person, simulation.feet(), visible_fractions(people.person, true), people.joints, tipped)
        instances = {name: view_image.instances for name, view_image in images_of_instances.items()}
        ranges = {name: view_image.range for name, view_image in images_of_instances.items()}
        kinds = {name: shot.classes for name, shot in shots.items() if shot.classes is not None}
        yield RenderedFrame(Tick(index, index * scenario.period, tuple(views)), truth, instances, true, ranges, kinds)


def robot_poses(simulation: Simulation, setup: Setup) -> dict[str, Pose]:
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
) -> tuple[dict[str, InstanceImage], dict[str, RenderedImage], dict[str, ViewTruth]]:
    """By camera, all of one moment: what it shows, with colours and classes, and what is true of it."""
    robots = robot_poses(simulation, setup)
    poses = [robots[mount.robot] @ mount.T_body_camera for mount in setup.mounts.values()]
    which = [renderer.cameras.index(mount.camera) for mount in setup.mounts.values()]
    shots = renderer.render(simulation.data, poses, which)
    unoccluded = renderer.unoccluded(simulation.data, poses, people.person.tolist(), which)
    images_of_instances, true = {}, {}
    for name, shot, pose, bodies in zip(setup.mounts, shots, poses, unoccluded, strict=True):
        images_of_instances[name] = InstanceImage(setup.mounts[name].camera, pose, shot.instances, shot.range)
        true[name] = true_view(images_of_instances[name], people, bodies, simulation.world)
    return images_of_instances, dict(zip(setup.mounts, shots, strict=True)), true


def visible_fractions(persons: Ints, views: Mapping[str, ViewTruth]) -> Array:
    """Visible fraction (m, cameras) of every person; 0 where a camera would not show the person at all."""
    out = np.zeros((len(persons), len(views)))
    row = {person: k for k, person in enumerate(persons.tolist())}
    for c, view in enumerate(views.values()):
        for person, visible in zip(view.boxes.person.tolist(), view.boxes.visible, strict=True):
            out[row[person], c] = visible
    return out


@dataclass(frozen=True, eq=False)
class Recording:
    """What is recorded: a simulation at its first frame, cameras beside those of its rovers, all that made them, as JSON values,
    and what is written."""

    scenario: Scenario
    simulation: Simulation
    fixed: Mapping[str, FixedCamera]
    provenance: dict[str, Any]
    form: ImageForm = field(default_factory=ImageForm)

    @staticmethod
    def of(scenario: Scenario) -> Recording:
        return Recording(scenario, Simulation(scenario), {}, json.loads(scenario.to_json()))


def record(scenario: Scenario, folder: Path, progress: Any = None) -> None:
    """Write the Sequence of a scenario into `folder`, which must not be there yet; nothing is left where it fails.

    progress: wraps the iterator of frames (tqdm, say), or None. Raises ValueError for a scenario that its world cannot hold.
    """
    check_absent(folder)
    write_recording(Recording.of(scenario), folder, progress)


def check_absent(folder: Path) -> None:
    """Raises ValueError where there is something of that name."""
    if folder.exists():
        raise ValueError(f"{folder}: is there already")


def write_recording(recording: Recording, folder: Path, progress: Any = None) -> None:
    """As `record`, of a stage."""
    check_absent(folder)
    scenario, simulation = recording.scenario, recording.simulation
    setup = make_setup(scenario, simulation, recording.fixed)
    occluders = setup.occluders
    assert isinstance(occluders, Grid)
    others = dict.fromkeys(one.camera for one in recording.fixed.values())
    with open_renderer(scenario, simulation, others) as renderer, SequenceWriter(folder, setup, occluders, recording.form) as writer:
        if recording.form.mesh:
            export(simulation.world, writer.partial / "terrain.glb")
        moments: Iterable[RenderedFrame] = run(scenario, simulation, setup, renderer)
        for moment in progress(moments, total=scenario.frames) if progress else moments:
            writer.add(moment.tick, moment.truth, Layers(moment.instances, moment.range, moment.classes), moment.views)
        writer.finish(recording.provenance, versions())


def versions() -> dict[str, str]:
    """Versions of what decides the bytes of a sequence."""
    return {name: importlib.metadata.version(name) for name in ("pilsim", "mujoco", "numpy", "scipy", "opencv-python-headless")}
