"""Run a scenario with rendered images, and write it as a sequence.

Truth, instances and images of a frame come from the same state of one MjData, so that they have no lag.
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

from sim.recording.calibration_error import error_rows, is_off, told_setup
from sim.recording.drawing_workers import DrawingWorkers, drawing_workers
from sim.recording.frame_loop import FrameState, simulated_frames, truth_of
from sim.recording.resumable import ResumableFrames
from sim.recording.tracker_setup import FixedCamera, make_setup
from sim.recording.view_rendering import ViewRenderer, effect_rows, is_plain, rendered_cameras
from sim.rendering.panorama import PanoramaRenderer, RenderedImage
from sim.rendering.semantic_labels import classes
from sim.scenario import Scenario
from sim.sensors.exposure import Exposure
from sim.sensors.keypoints import InstanceImage
from sim.sensors.person_detector import true_view
from sim.sensors.robot_detector import RobotDetector
from sim.sensors.robot_sensors import RobotSensors
from sim.sensors.view_detectors import ViewDetectors
from sim.simulation.simulation import Simulation
from tracker.geometry.cameras import Camera, Panorama
from tracker.geometry.ground import Grid
from tracker.io.atomic import is_free
from tracker.sequence.writer import ImageForm, Layers, SequenceWriter
from tracker.types import SensorSamples, Setup, Tick, Truth, View, ViewTruth
from worlds.export import export


@dataclass(frozen=True, eq=False)
class RenderedFrame:
    """One frame: the tick for the tracker, the truth, and by camera the truth of the view and images.

    instances: (H, W), 0 for nobody. range: (H, W) m along the ray, inf for no hit. classes: (H, W) of worlds.semantics.
    samples: of the robots' own sensors since the frame before. rows: of truth/rows.csv, empty where all rows show one time.
    """

    tick: Tick
    truth: Truth
    instances: dict[str, NDArray[np.uint16]]
    views: dict[str, ViewTruth]
    range: dict[str, NDArray[np.float32]]
    classes: dict[str, NDArray[np.uint8]]
    samples: SensorSamples = field(default_factory=SensorSamples)
    rows: list[list[object]] = field(default_factory=list)


def open_renderer(scenario: Scenario, simulation: Simulation, others: Iterable[Camera] = ()) -> PanoramaRenderer:
    """A renderer for the cameras of all robots and for other cameras. Its instances are the people. Close it, or use it as a context."""
    panoramas = [Panorama(scenario.width, scenario.height), *others]
    cameras = panoramas if is_plain(scenario) else rendered_cameras(scenario, others)
    return PanoramaRenderer(simulation.model, cameras, simulation.person_of_geom.astype(np.uint16), classes(simulation.model))


def run(
    scenario: Scenario, simulation: Simulation, setup: Setup, renderer: PanoramaRenderer, sensors: RobotSensors | None = None
) -> Iterator[RenderedFrame]:
    """The frames of a scenario, rendered. The renderer must have been opened with every camera of the setup.

    sensors: those of the scenario where they are made already.
    """
    detectors = ViewDetectors(scenario, setup.mounts, simulation.all_persons)
    robot_detector = RobotDetector(scenario, setup, simulation)
    exposures = {
        name: Exposure(scenario.exposure, scenario.image_noise, scenario.period, scenario.stream(f"exposure/{name}")) for name in setup.mounts
    }
    view_renderer = None if is_plain(scenario) else ViewRenderer(scenario, simulation, setup, renderer)
    for state in simulated_frames(scenario, simulation, setup, sensors):
        images, true = view_renderer.render(state) if view_renderer else _rendered_views(simulation, setup, renderer, state)
        views, feet, odometry = [], simulation.feet(), dict(state.odometry)
        for name, mount in setup.mounts.items():
            found = detectors.detect(name, true[name], state.people.person, feet)
            image, robots = images[name].colour, robot_detector.detect(name)
            image = image if view_renderer else exposures[name].apply(image)
            # The first view of a robot brings its odometry.
            views.append(View(name, found, odometry=odometry.pop(mount.robot, None), image=image, robot_detections=robots))
        instances = {name: image.instances for name, image in images.items()}
        ranges = {name: image.range for name, image in images.items()}
        kinds = {name: image.classes for name, image in images.items() if image.classes is not None}
        tick = Tick(state.index, state.index * scenario.period, tuple(views))
        rows = view_renderer.row_rows(state) if view_renderer else []
        yield RenderedFrame(tick, truth_of(state, simulation, true), instances, true, ranges, kinds, state.samples, rows)


def _rendered_views(
    simulation: Simulation, setup: Setup, renderer: PanoramaRenderer, state: FrameState
) -> tuple[dict[str, RenderedImage], dict[str, ViewTruth]]:
    """Camera → rendered image, and camera → truth of its view, of the current frame."""
    poses = [state.robots[mount.robot] @ mount.T_body_camera for mount in setup.mounts.values()]
    which = [renderer.cameras.index(mount.camera) for mount in setup.mounts.values()]
    images = renderer.render(simulation.data, poses, which)
    unoccluded = renderer.unoccluded(simulation.data, poses, state.people.person.tolist(), which)
    true = {}
    for name, image, pose, extents in zip(setup.mounts, images, poses, unoccluded, strict=True):
        instance_image = InstanceImage(setup.mounts[name].camera, pose, image.instances, image.range)
        true[name] = true_view(instance_image, state.people, extents, simulation.world)
    return dict(zip(setup.mounts, images, strict=True)), true


@dataclass(frozen=True, eq=False)
class Recording:
    """A sequence to be written: a simulation at its first frame, and fixed cameras by name.

    provenance: JSON values that describe how it was made. form: which images are written, and how.
    workers: processes that draw; this process draws where None. cluster: address of a Dask scheduler whose workers draw in their place.
    Both are for sequences that `in_any_order` allows. The bytes do not depend on either.
    """

    scenario: Scenario
    simulation: Simulation
    fixed: Mapping[str, FixedCamera]
    provenance: dict[str, Any]
    form: ImageForm = field(default_factory=ImageForm)
    workers: DrawingWorkers | None = None
    cluster: str | None = None

    @staticmethod
    def of(scenario: Scenario, workers: DrawingWorkers | None = None) -> Recording:
        return Recording(scenario, Simulation(scenario), {}, json.loads(scenario.to_json()), workers=workers)


def record(scenario: Scenario, folder: Path, progress: Any = None, workers: int = 1) -> None:
    """Write the sequence of a scenario into the new or empty folder `folder`. Nothing is left there after an error, but for an OSError.

    A run that was killed, or ended by an OSError, is resumed at the first frame whose images are not there.
    workers: number of processes that draw; with one, this process draws. The bytes do not depend on it.
    progress: wraps the iterator of frames (tqdm, for example), or None.
    Raises Kept for an OSError, with the place of unfinished files.
    Raises ValueError if the folder is not empty, or if robots or people do not fit into the world.
    """
    check_absent(folder)
    with drawing_workers(drawing_processes(scenario, ImageForm(), workers)) as drawing:
        write_recording(Recording.of(scenario, drawing), folder, progress)


def check_absent(folder: Path) -> None:
    """Raises ValueError if `folder` exists and is no empty folder."""
    if not is_free(folder):
        raise ValueError(f"{folder}: is there already")


def write_recording(recording: Recording, folder: Path, progress: Any = None) -> None:
    """As `record`, for a prepared Recording."""
    check_absent(folder)
    scenario, simulation = recording.scenario, recording.simulation
    setup = make_setup(scenario, simulation, recording.fixed)
    occluders = setup.occluders
    assert isinstance(occluders, Grid)
    others = dict.fromkeys(one.camera for one in recording.fixed.values())
    sensors = RobotSensors.of(scenario, simulation, setup)
    told = told_setup(scenario, simulation, setup) if is_off(scenario) else setup
    written = SequenceWriter(folder, told, occluders, recording.form, sensors.setup() if sensors else None)
    if scenario.effects:
        written.add_effects(_effect_rows(scenario, simulation, setup), setup, scenario.camera_effects.moves)
    if in_any_order(scenario, recording.form):
        frames_of = ResumableFrames(scenario, simulation, setup, recording.form, recording.workers, recording.cluster)
        frames_of.write(written, sensors, (recording.provenance, versions()), progress, export_mesh=recording.form.mesh)
        return
    with open_renderer(scenario, simulation, others) as renderer, written as writer:
        if recording.form.mesh:
            export(simulation.world, writer.partial / "terrain.glb")
        frames: Iterable[RenderedFrame] = run(scenario, simulation, setup, renderer, sensors)
        for frame in progress(frames, total=scenario.frames) if progress else frames:
            writer.add(frame.tick, frame.truth, Layers(frame.instances, frame.range, frame.classes), frame.views)
            writer.add_samples(frame.tick.index, frame.samples)
            writer.add_rows(frame.rows)
        writer.finish(recording.provenance, versions())


def in_any_order(scenario: Scenario, form: ImageForm) -> bool:
    """Whether the frames of a sequence can be drawn in any order, so that several workers draw it, and it is resumed within."""
    return is_plain(scenario) and not form.video


def drawing_processes(scenario: Scenario, form: ImageForm, workers: int) -> int:
    """How many of `workers` processes a sequence can use: one where its frames are drawn in their order, and not more than it has frames."""
    return min(workers, scenario.frames) if in_any_order(scenario, form) else 1


def _effect_rows(scenario: Scenario, simulation: Simulation, setup: Setup) -> list[list[object]]:
    """Rows of truth/effects.csv: what the cameras' effects are."""
    return effect_rows(scenario, simulation, setup) + error_rows(scenario, simulation, setup)


def versions() -> dict[str, str]:
    """Versions of the packages on which the bytes of a sequence depend."""
    return {name: importlib.metadata.version(name) for name in ("pilsim", "mujoco", "numpy", "scipy", "opencv-python-headless")}
