"""Writing of a sequence that can be killed at any moment and resumed within it, drawn by one or several processes or a cluster.

The simulation runs ahead and hands moments to the drawing. Random errors of detectors are drawn here, in the order of the frames.
A resumed run simulates from frame 0, which takes a fraction of the time of drawing, and skips the drawing of frames that are on disk.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sim.recording.cluster_drawing import ClusterDrawing
from sim.recording.drawing import Drawn, DrawnScene, Moment, MomentRenderer
from sim.recording.drawing_workers import DrawingWorkers
from sim.recording.frame_journal import FrameJournal
from sim.recording.frame_loop import FrameState, simulated_frames, truth_of, visible_fractions
from sim.scenario import Scenario
from sim.sensors.exposure import Exposure
from sim.sensors.person_detector import truth_above
from sim.sensors.robot_detector import RobotDetector
from sim.sensors.robot_sensors import RobotSensors
from sim.sensors.view_detectors import ViewDetectors
from sim.simulation.simulation import Simulation
from tracker.geometry import Array, Pose
from tracker.sequence.writer import ImageForm, SequenceWriter, view_name
from tracker.types import RobotDetections, Setup, Tick, Truth, View
from worlds.export import export


@dataclass(frozen=True, eq=False)
class _Simulated:
    """What the simulation gives for one frame. poses: T_world_camera by camera. truth: without the views. feet (m, 3): of the people."""

    state: FrameState
    poses: list[Pose]
    truth: Truth
    feet: Array
    robots: dict[str, RobotDetections | None]


class ResumableFrames:
    """The frames of a scenario, from its simulation at frame 0. workers, cluster: as of Recording."""

    def __init__(
        self,
        scenario: Scenario,
        simulation: Simulation,
        setup: Setup,
        form: ImageForm,
        workers: DrawingWorkers | None = None,
        cluster: str | None = None,
    ) -> None:
        self._scenario, self._simulation, self._setup, self._form = scenario, simulation, setup, form
        self._workers, self._cluster = workers, cluster
        self._exposures = {
            name: Exposure(scenario.exposure, scenario.image_noise, scenario.period, scenario.stream(f"exposure/{name}")) for name in setup.mounts
        }
        self._raw = any(not exposure.is_off for exposure in self._exposures.values())
        self._detectors = ViewDetectors(scenario, setup.mounts, simulation.all_persons)
        self._simulated: deque[_Simulated] = deque()

    def write(
        self, writer: SequenceWriter, sensors: RobotSensors | None, made_by: tuple[dict[str, Any], dict[str, str]], progress: Any, export_mesh: bool
    ) -> None:
        """Write all frames and finish the sequence. made_by: provenance and versions. progress: as of `record`."""
        journal = FrameJournal(writer.partial, {"provenance": made_by[0], "versions": made_by[1], "form": vars(self._form)})
        writer.resumed, writer.resumable = journal.found, True
        with writer:
            journal.open()
            writer.images.checksums.update(journal.checksums)
            if export_mesh:
                export(self._simulation.world, writer.partial / "terrain.glb")
            with journal, ExitStack() as stack:
                drawn = self._drawn(journal, sensors, made_by[1], stack)
                for one in progress(drawn, total=self._scenario.frames) if progress else drawn:
                    self._add(writer, journal, self._simulated.popleft(), one)
                writer.images.wait()
            journal.remove()
            writer.finish(*made_by)

    def _drawn(
        self, journal: FrameJournal, sensors: RobotSensors | None, versions: dict[str, str], stack: ExitStack
    ) -> Iterator[Drawn | None]:
        """What is drawn of each frame, in order; None for a frame that the journal has."""
        moments = self._moments(journal, sensors)
        missing = self._scenario.frames - len(journal.drawn)
        if not missing:
            for _ in moments:
                yield None
            return
        scene = DrawnScene.of(self._simulation, self._setup, self._form, self._raw)
        if self._cluster is not None:
            cluster = stack.enter_context(ClusterDrawing(scene, self._cluster, missing, versions))
            yield from cluster.draw(moments)
            return
        if self._workers is not None:
            yield from self._workers.draw(scene, moments)
            return
        renderer = stack.enter_context(MomentRenderer(scene))
        for moment in moments:
            yield None if moment is None else renderer.draw(moment)

    def _moments(self, journal: FrameJournal, sensors: RobotSensors | None) -> Iterator[Moment | None]:
        robot_detector = RobotDetector(self._scenario, self._setup, self._simulation)
        for state in simulated_frames(self._scenario, self._simulation, self._setup, sensors):
            moment = Moment.of(state, self._simulation, self._setup)
            robots = {name: robot_detector.detect(name) for name in self._setup.mounts}
            truth = truth_of(state, self._simulation, {})
            self._simulated.append(_Simulated(state, moment.poses, truth, self._simulation.feet(), robots))
            yield None if state.index in journal.drawn else moment

    def _add(self, writer: SequenceWriter, journal: FrameJournal, simulated: _Simulated, drawn: Drawn | None) -> None:
        """Add one frame to the sequence."""
        state = simulated.state
        people = journal.drawn[state.index] if drawn is None else drawn.people
        true, views = {}, []
        for (name, mount), pose in zip(self._setup.mounts.items(), simulated.poses, strict=True):
            true[name] = truth_above(self._simulation.world, pose, *people[name])
            found = self._detectors.detect(name, true[name], state.people.person, simulated.feet)
            views.append(View(name, found, odometry=state.odometry.get(mount.robot), robot_detections=simulated.robots[name]))
        truth = replace(simulated.truth, visible=visible_fractions(state.people.person, true))
        writer.add(Tick(state.index, state.index * self._scenario.period, tuple(views)), truth, None, true)
        writer.add_samples(state.index, state.samples)
        names = self._put_images(writer, state.index, drawn)
        if drawn is not None:
            journal.add(state.index, people, names, writer.images.checksums)

    def _put_images(self, writer: SequenceWriter, frame: int, drawn: Drawn | None) -> list[str]:
        """Queue the images of a frame, and return their names. The random streams of exposure advance for frames on disk, too."""
        names = [] if drawn is None else list(drawn.files)
        for name, content in drawn.files.items() if drawn is not None else ():
            writer.images.put_encoded(name, content)
        for camera, exposure in self._exposures.items() if self._raw else ():
            size = self._setup.mounts[camera].camera
            pixels = exposure.apply(np.zeros((size.height, size.width, 3), np.uint8) if drawn is None else drawn.colours[camera])
            if drawn is not None:
                path, options = self._form.colour_file(view_name(camera, frame))
                writer.images.put(path, pixels[:, :, ::-1], options)
                names.append(path)
        return names
