"""A simulation before fixed cameras written as a recording without images: boxes by ray casting, and truth."""

from __future__ import annotations

from collections import defaultdict
from pathlib import Path

import numpy as np

from sim.recording.frames import raycast_frames
from sim.recording.record import SimulatedSequence
from sim.recording.tracker_setup import make_setup
from tracker.detections.boxes import boxes_of_detections
from tracker.geometry import Array, Ints
from tracker.io.atomic import new_folder, write_text
from tracker.io.json_files import json_text
from tracker.io.progress import progress_bar
from tracker.recordings import FrameBoxes, Recording, RecordingCamera
from tracker.recordings.clocks import CameraClock
from tracker.recordings.folder import write_recording
from tracker.types import Detections, Setup

README = """# A recording without images, by pilsim

    recording.json          rate [1/s], area [m], ground [terrain.npz], height [m], frames, and the cameras (OpenCV, x_camera = R x_world + t [m])
    detections/CAMERA.txt   MOT15, frames from 1: frame, -1, left, top, width, height [px], confidence, -1, -1, -1
    times.csv               of cameras that are not in step: camera, frame from 1, time [s]; frames that are not in it did not arrive
    truth.txt               MOT15, frames from 1: frame, id, -1, -1, -1, -1, visible share, x, y, z [m, the ground under the body]
    scenario.json           how it was made: the scenario, and the source of a twin under `twin`
"""


def write_raycast_recording(made: SimulatedSequence, folder: Path, area: Array | None = None) -> None:
    """Write the boxes of fixed cameras, by ray casting, and the truth. There are no rovers, since their SLAM needs images.

    area (2, 2): lowest and highest x, y, m, in which people are reported, or None.
    """
    setup = make_setup(made.simulation, made.fixed)
    detections: dict[str, dict[int, tuple[Array, Array]]] = {name: {} for name in setup.mounts}
    truth: dict[int, tuple[Ints, Array]] = {}
    visible, stamps = dict[int, Array](), defaultdict[str, dict[int, float]](dict)
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
    clocks = {name: CameraClock(stamps=of_camera) for name, of_camera in stamps.items()}
    cameras = {name: RecordingCamera(one.camera, one.T_world_camera) for name, one in made.fixed.items()}
    boxes_of: dict[str, FrameBoxes] = dict(detections)
    recording = Recording(
        made.scenario.rate, cameras, boxes_of, truth, frames=made.scenario.frames, area=area, ground=setup.ground, height=setup.height,
        occluders=setup.occluders, visible=visible, clocks=clocks,
    )  # fmt: skip
    with new_folder(folder) as unfinished:
        write_recording(unfinished, recording)
        write_text(unfinished / "scenario.json", json_text(made.provenance, indent=1) + "\n")
        write_text(unfinished / "README.md", README)


def _boxes(setup: Setup, name: str, found: Detections) -> Array:
    """Boxes (n, 4) px with the origin of OpenCV's pixels."""
    camera = setup.mounts[name].camera
    return np.asarray(boxes_of_detections(camera, found) + np.array([camera.pixel_centre - 0.5] * 2 + [0.0, 0.0]))
