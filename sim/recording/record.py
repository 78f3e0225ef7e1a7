"""Run a scenario with rendered images, in memory or as a written sequence. A run that is killed at any moment can be resumed.

Truth, instances and images of a frame come from the same state of one MjData, so that they have no lag.
The simulation runs ahead and passes moments to the renderer in this process, in workers or on a cluster. Random numbers are drawn here, in the order
of the frames. A resumed run simulates from frame 0, which takes a fraction of the time of drawing, and skips the drawing of frames that are on disk.
"""

from __future__ import annotations

import importlib.metadata
import json
from collections import deque
from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from sim.recording.drawing import DrawingWorkers, Drawn, DrawnScene, MomentRenderer, draw_on_cluster, drawing_workers
from sim.recording.frame_journal import FrameJournal
from sim.recording.frames import Frame, FrameAssembler, FrameState, simulated_frames
from sim.recording.shots import CameraColours, Moment, ShotPlan, effect_rows
from sim.recording.tracker_setup import cameras_of, make_setup, told_setup
from sim.scenario import Scenario
from sim.sensors.robot_sensors import RobotSensors
from sim.sensors.true_boxes import truth_above
from sim.simulation.simulation import Simulation
from tracker.geometry import Pose
from tracker.geometry.ground import Grid
from tracker.io.atomic import is_free, write_text
from tracker.recordings import RecordingCamera
from tracker.sequence.schema import PLACE_FILE
from tracker.sequence.writer import ImageForm, SequenceWriter
from tracker.types import Boxes, Keypoints, Setup, ViewTruth
from worlds.export import export


def rendered_frames(simulation: Simulation, setup: Setup) -> Iterator[Frame]:
    """The frames of a scenario with their images, in memory."""
    scenario = simulation.scenario
    plan, assembler = ShotPlan(simulation, setup), FrameAssembler(simulation, setup)
    colours = CameraColours(scenario, plan.rigs)
    with MomentRenderer(DrawnScene.of(simulation, plan, ImageForm(), raw=True)) as renderer:
        for state in simulated_frames(simulation, setup):
            moment = plan.moment(state)
            rendered, rows = renderer.render(moment), plan.rows(state)
            colour = colours.images(rendered.lenses)
            images = {name: replace(image, colour=colour[name]) for name, image in rendered.images.items()}
            frame = assembler.frame(state, _truth(simulation, moment.views, rendered.people), images)
            yield replace(frame, rows=rows)


def _truth(simulation: Simulation, poses: Mapping[str, Pose], people: Mapping[str, tuple[Boxes, Keypoints]]) -> dict[str, ViewTruth]:
    """Camera → truth of its view. poses: camera → T_world_camera. people: camera → boxes and key points."""
    return {name: truth_above(simulation.world, pose, *people[name]) for name, pose in poses.items()}


@dataclass(frozen=True, eq=False)
class SimulatedSequence:
    """A sequence to be written: a simulation at its first frame, and fixed cameras by name.

    provenance: JSON values that describe how it was made. form: which images are written, and how.
    workers: processes that draw; this process draws where None. cluster: address of a Dask scheduler whose workers draw in their place.
    The bytes do not depend on either.
    """

    simulation: Simulation
    fixed: Mapping[str, RecordingCamera]
    provenance: dict[str, Any]
    form: ImageForm = field(default_factory=ImageForm)
    workers: DrawingWorkers | None = None
    cluster: str | None = None

    @staticmethod
    def of(scenario: Scenario, workers: DrawingWorkers | None = None) -> SimulatedSequence:
        simulation = Simulation(scenario)
        return SimulatedSequence(simulation, cameras_of(simulation.world, scenario.view_width), json.loads(scenario.to_json()), workers=workers)

    @property
    def scenario(self) -> Scenario:
        """The scenario of the simulation."""
        return self.simulation.scenario


def record(scenario: Scenario, folder: Path, progress: Any = None, workers: int = 1) -> None:
    """Write the sequence of a scenario into the new or empty folder `folder`. After an error other than an OSError, nothing is left there.

    A run that was killed, or ended by an OSError, is resumed at the first frame whose images are missing. With videos it starts anew.
    workers: number of processes that draw; with one, this process draws. The bytes do not depend on it.
    progress: wraps the iterator of frames (tqdm, for example), or None.
    Raises Kept for an OSError, with the place of unfinished files.
    Raises ValueError if the folder is not empty, or if robots or people do not fit into the world.
    """
    check_absent(folder)
    with drawing_workers(min(workers, scenario.frames)) as drawing:
        write_sequence(SimulatedSequence.of(scenario, drawing), folder, progress)


def check_absent(folder: Path) -> None:
    """Raises ValueError if `folder` exists and is not an empty folder."""
    if not is_free(folder):
        raise ValueError(f"{folder}: is there already")


def write_sequence(recording: SimulatedSequence, folder: Path, progress: Any = None) -> None:
    """As `record`, for a prepared SimulatedSequence."""
    check_absent(folder)
    scenario, simulation, form = recording.scenario, recording.simulation, recording.form
    if scenario.view_clock:
        raise ValueError("view_clock is for cameras without rendering: images are rendered at the frames alone (--no-render)")
    setup = make_setup(simulation, recording.fixed)
    assert isinstance(setup.occluders, Grid)
    sensors, told = RobotSensors.of(simulation, setup), told_setup(simulation, setup)
    writer = SequenceWriter(folder, told, setup.occluders, form, sensors.setup() if sensors else None)
    if scenario.effects:
        writer.add_effects(effect_rows(simulation, setup), setup, scenario.camera_effects.moves)
    made_with = versions()
    about = {"provenance": recording.provenance, "versions": made_with, "form": vars(form)}
    # A video cannot be continued.
    journal = FrameJournal(writer.partial, about, resumes=not form.video)
    writer.resumed, writer.resumable = journal.found, not form.video
    with writer:
        with journal:
            writer.images.checksums.update(journal.checksums)
            if form.mesh:
                export(simulation.world, writer.partial / "terrain.glb")
            if simulation.world.place:
                write_text(writer.partial / PLACE_FILE, simulation.world.place)
            _Frames(recording, setup, journal).write(writer, sensors, progress)
            writer.images.wait()
        journal.remove()
        writer.finish(recording.provenance, made_with)


class _Frames:
    """The frames of a recording that is being written, from its simulation at frame 0."""

    def __init__(self, recording: SimulatedSequence, setup: Setup, journal: FrameJournal) -> None:
        self._recording, self._setup, self._journal = recording, setup, journal
        scenario, simulation = recording.scenario, recording.simulation
        self._plan, self._assembler = ShotPlan(simulation, setup), FrameAssembler(simulation, setup)
        self._colours = CameraColours(scenario, self._plan.rigs)
        self._raw = self._colours.changed or recording.form.video
        self._simulated: deque[tuple[FrameState, dict[str, Pose], list[list[object]]]] = deque()
        """State, T_world_camera by camera, and rows of truth/rows.csv of frames that are not drawn yet."""

    def write(self, writer: SequenceWriter, sensors: RobotSensors | None, progress: Any) -> None:
        """Write all frames. progress: as of `record`."""
        with ExitStack() as stack:
            drawn = self._drawn(sensors, stack)
            for one in progress(drawn, total=self._recording.scenario.frames) if progress else drawn:
                self._add(writer, one)

    def _drawn(self, sensors: RobotSensors | None, stack: ExitStack) -> Iterator[Drawn | None]:
        """The drawn frames, in order; None for a frame that the journal has."""
        made, moments = self._recording, self._moments(sensors)
        missing = made.scenario.frames - len(self._journal.drawn)
        scene = DrawnScene.of(made.simulation, self._plan, made.form, self._raw)
        if not missing:
            yield from (None for _ in moments)
        elif made.cluster is not None:
            yield from draw_on_cluster(scene, moments, missing, made.cluster, versions())
        elif made.workers is not None:
            yield from made.workers.draw(scene, moments)
        else:
            renderer = stack.enter_context(MomentRenderer(scene))
            yield from (None if moment is None else renderer.draw(moment) for moment in moments)

    def _moments(self, sensors: RobotSensors | None) -> Iterator[Moment | None]:
        made = self._recording
        for state in simulated_frames(made.simulation, self._setup, sensors):
            moment = self._plan.moment(state)
            self._simulated.append((state, moment.views, self._plan.rows(state)))
            yield None if state.index in self._journal.drawn else moment

    def _add(self, writer: SequenceWriter, drawn: Drawn | None) -> None:
        """Add the next frame to the sequence."""
        state, poses, rows = self._simulated.popleft()
        people = self._journal.drawn[state.index] if drawn is None else drawn.people
        frame = self._assembler.frame(state, _truth(self._recording.simulation, poses, people))
        writer.add(frame.tick, frame.truth, frame.views)
        writer.add_samples(state.index, frame.samples)
        writer.add_rows(rows)
        if drawn is None:
            if self._raw:
                self._colours.skip()
            return
        for name, content in drawn.files.items():
            writer.images.put_encoded(name, content)
        colours = self._colours.images(drawn.colours) if self._raw else {}
        names = [writer.add_image(state.index, camera, image) for camera, image in colours.items()]
        self._journal.add(state.index, people, [*drawn.files, *names], writer.images.checksums)


def versions() -> dict[str, str]:
    """Versions of the packages on which the bytes of a sequence depend."""
    return {name: importlib.metadata.version(name) for name in ("pilsim", "mujoco", "numpy", "scipy", "opencv-python-headless")}
