"""A simulation written as a recording without images: boxes by ray casting, odometry and mutual sightings of robots, and truth."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from sim.recording.frames import Frame, raycast_frames
from sim.recording.record import SimulatedSequence
from sim.recording.tracker_setup import make_setup, told_setup
from tracker.detections.boxes import boxes_of_detections
from tracker.geometry import Array, Ints, Pose
from tracker.io.atomic import new_folder, write_text
from tracker.io.json_files import json_text
from tracker.io.progress import progress_bar
from tracker.recordings import FrameBoxes, Recording, RecordingCamera, RecordingRobot
from tracker.recordings.clocks import CameraClock
from tracker.recordings.folder import write_recording
from tracker.sequence.schema import PLACE_FILE
from tracker.types import Detections, Odometry, RobotDetections, Setup

README = """# A recording without images, by pilsim

    recording.json          rate [1/s], area [m], ground [terrain.npz], height [m], frames, and the cameras (OpenCV, x_camera = R x_world + t [m])
    detections/CAMERA.txt   MOT15, frames from 1: frame, -1, left, top, width, height [px], confidence, -1, -1, -1
    times.csv               of cameras that are not in step: camera, frame from 1, time [s]; frames that are not in it did not arrive
    truth.txt               MOT15, frames from 1: frame, id, -1, -1, -1, -1, visible share, x, y, z [m, the ground under the body]
    robots.json             with robots: their start; odometry.csv, robot_truth.csv and robot_detections.csv have their rows
    scenario.json           how it was made: the scenario, and the source of a twin under `twin`
"""


@dataclass(frozen=True)
class _RobotTables:
    """Data of robots in a recording, by frame: robot → odometry and true pose; camera → the robots that it sees."""

    motion: dict[str, dict[int, Odometry]] = field(default_factory=lambda: defaultdict(dict))
    poses: dict[str, dict[int, Pose]] = field(default_factory=lambda: defaultdict(dict))
    seen: dict[str, dict[int, RobotDetections]] = field(default_factory=lambda: defaultdict(dict))

    def add(self, frame: Frame, setup: Setup) -> None:
        """Add a frame."""
        for view in frame.tick.views:
            robot, index = setup.mounts[view.camera].robot, frame.tick.index
            if robot not in setup.moving_robots:
                continue
            self.poses[robot][index] = frame.truth.T_world_robot[robot]
            if view.odometry is not None:
                self.motion[robot][index] = view.odometry
            if view.robot_detections is not None:
                self.seen[view.camera][index] = view.robot_detections

    def robots(self, setup: Setup) -> dict[str, RecordingRobot]:
        """The robots with their starts."""
        return {name: RecordingRobot(setup.starts[name], self.motion[name], self.poses[name]) for name in setup.moving_robots}


def write_raycast_recording(made: SimulatedSequence, folder: Path, area: Array | None = None) -> None:
    """Write boxes of fixed cameras and robots, by ray casting, and the truth. Robots have odometry and sightings of each other, but no landmarks.

    area (2, 2): lowest and highest x, y, m, in which people are reported, or None.
    """
    setup = make_setup(made.simulation, made.fixed)
    detections: dict[str, dict[int, tuple[Array, Array]]] = {name: {} for name in setup.mounts}
    truth: dict[int, tuple[Ints, Array]] = {}
    visible, stamps = dict[int, Array](), defaultdict[str, dict[int, float]](dict)
    told = told_setup(made.simulation, setup)
    moved = _RobotTables()
    for frame in progress_bar(raycast_frames(made.simulation, setup), total=made.scenario.frames, desc="frames", unit="frame"):
        index = frame.tick.index
        truth[index], visible[index] = (frame.truth.person_id, frame.truth.feet), frame.truth.visible.max(axis=1, initial=0.0)
        found = {view.camera: (index, view.detections) for view in frame.tick.views}
        for name, taken in frame.pictures.items():
            stamps[name][taken.picture.number] = taken.picture.time
            found[name] = taken.picture.number, taken.detections
        for name, (number, boxes) in found.items():
            if len(boxes):
                detections[name][number] = _boxes(setup, name, boxes), boxes.confidence
        moved.add(frame, setup)
    clocks = {name: CameraClock(stamps=of_camera) for name, of_camera in stamps.items()}
    cameras = dict(made.fixed)
    cameras |= {name: RecordingCamera(m.camera, m.T_body_camera, m.robot) for name, m in told.mounts.items() if m.robot in setup.moving_robots}
    boxes_of: dict[str, FrameBoxes] = dict(detections)
    recording = Recording(
        made.scenario.rate, cameras, boxes_of, truth, frames=made.scenario.frames, area=area, ground=setup.ground, height=setup.height,
        occluders=setup.occluders, visible=visible, clocks=clocks, robots=moved.robots(setup), robot_detections=moved.seen,
    )  # fmt: skip
    with new_folder(folder) as unfinished:
        write_recording(unfinished, recording)
        write_text(unfinished / "scenario.json", json_text(made.provenance, indent=1) + "\n")
        if made.simulation.world.place:
            write_text(unfinished / PLACE_FILE, made.simulation.world.place)
        write_text(unfinished / "README.md", README)


def _boxes(setup: Setup, name: str, found: Detections) -> Array:
    """Boxes (n, 4) px with the origin of OpenCV's pixels."""
    camera = setup.mounts[name].camera
    return np.asarray(boxes_of_detections(camera, found) + np.array([camera.pixel_centre - 0.5] * 2 + [0.0, 0.0]))
