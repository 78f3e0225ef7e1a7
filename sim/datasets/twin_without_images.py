"""Writing of a twin without rendering: its boxes, by ray casting, and its truth as a recording that `pilsim track` reads."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from sim.recording.raycast_run import run_raycast
from sim.recording.record import Recording as RecordingToWrite
from sim.recording.record import check_absent
from sim.recording.tracker_setup import make_setup
from tracker.detections.boxes import boxes_of_detections
from tracker.geometry import Array, Ints
from tracker.io.atomic import new_folder, write_text
from tracker.io.json_files import json_text
from tracker.recordings import FrameBoxes, Recording, RecordingCamera
from tracker.recordings.folder import write_recording

README = """# A twin without images, by pilsim

    recording.json          rate [1/s], area [m], ground [terrain.npz], height [m], frames, and the cameras (OpenCV, x_camera = R x_world + t [m])
    detections/CAMERA.txt   MOT15, frames from 1: frame, -1, left, top, width, height [px], confidence, -1, -1, -1
    truth.txt               MOT15, frames from 1: frame, id, -1, -1, -1, -1, visible share, x, y, z [m, the ground under the body]
    scenario.json           how it was made: the scenario, and the source under `twin`
"""


def write_without_images(made: RecordingToWrite, folder: Path, area: Array | None = None, progress: Any = None) -> None:
    """Write the twin into the new folder `folder`. It has the fixed cameras only, since the SLAM of rovers needs more than boxes.

    area (2, 2): lowest and highest x, y, m, in which people are reported, or None. progress: wraps the iteration over frames.
    Raises ValueError for a folder that is not empty, and for a twin with rovers.
    """
    check_absent(folder)
    if made.scenario.robots:
        raise ValueError(f"robots is {made.scenario.robots}, needs 0 without rendering: the SLAM of rovers needs images")
    setup = make_setup(made.scenario, made.simulation, made.fixed)
    frames = run_raycast(made.scenario, made.simulation, setup)
    detections: dict[str, dict[int, tuple[Array, Array]]] = {name: {} for name in setup.mounts}
    truth: dict[int, tuple[Ints, Array]] = {}
    visible: dict[int, Array] = {}
    for frame in progress(frames, total=made.scenario.frames) if progress else frames:
        index = frame.tick.index
        truth[index], visible[index] = (frame.truth.person_id, frame.truth.feet), frame.truth.visible.max(axis=1, initial=0.0)
        for view in frame.tick.views:
            camera = setup.mounts[view.camera].camera
            if len(view.detections):
                corner = np.array([camera.pixel_centre - 0.5] * 2 + [0.0, 0.0])
                boxes = boxes_of_detections(camera, view.detections) + corner
                detections[view.camera][index] = boxes, view.detections.confidence
    cameras = {name: RecordingCamera(one.camera, one.T_world_camera) for name, one in made.fixed.items()}
    found: dict[str, FrameBoxes] = dict(detections)
    recording = Recording(
        made.scenario.rate,
        cameras,
        found,
        truth,
        frames=made.scenario.frames,
        area=area,
        ground=setup.ground,
        height=setup.height,
        occluders=setup.occluders,
        visible=visible,
    )
    with new_folder(folder) as unfinished:
        write_recording(unfinished, recording)
        write_text(unfinished / "scenario.json", json_text(made.provenance, indent=1) + "\n")
        write_text(unfinished / "README.md", README)
