"""Generation of the twin of any source, rendered as a sequence, or without images as a recording."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np

from sim.datasets.twin import annotated_overlaps, recording_of
from sim.datasets.twin_picture import draw_twin
from sim.datasets.twin_sources import Twin, true_motion
from sim.parallel.pool import Pool, usable_cores
from sim.recording.drawing_workers import drawing_workers
from sim.recording.frames import raycast_frames
from sim.recording.record import SimulatedSequence, check_absent, write_sequence
from sim.recording.tracker_setup import make_setup
from tracker.detections.boxes import boxes_of_detections
from tracker.geometry import Array, Ints
from tracker.io.atomic import new_folder, write_text
from tracker.io.file_lock import folder_lock
from tracker.io.json_files import json_text
from tracker.io.progress import progress_bar
from tracker.recordings import FrameBoxes, Recording, RecordingCamera
from tracker.recordings.folder import write_recording
from tracker.sequence.truth_tables import read_boxes

README = """# A twin without images, by pilsim

    recording.json          rate [1/s], area [m], ground [terrain.npz], height [m], frames, and the cameras (OpenCV, x_camera = R x_world + t [m])
    detections/CAMERA.txt   MOT15, frames from 1: frame, -1, left, top, width, height [px], confidence, -1, -1, -1
    truth.txt               MOT15, frames from 1: frame, id, -1, -1, -1, -1, visible share, x, y, z [m, the ground under the body]
    scenario.json           how it was made: the scenario, and the source under `twin`
"""


def generate_twin(twin: Twin, out: Path, render: bool = True, workers: int | None = None) -> Iterator[str]:
    """Write the twin into the new folder `out`, and yield lines that say what there is. Raises ValueError, in one line, for invalid sources.

    render: False for a recording without images and rovers. workers: number of processes that draw, None for one a core.
    """
    if not render:
        if twin.robots:
            raise ValueError(f"robots is {twin.robots}, needs 0 without rendering: the SLAM of rovers needs images")
        twin = dataclasses.replace(twin, robots=0)
    check_absent(out)
    count = Pool(usable_cores() if workers is None else workers).workers
    # A folder that cannot be written is named before the sources are read.
    with folder_lock(out):
        motion = true_motion(twin)
        _write(recording_of(twin, motion), render, motion.area, count, out)
        yield f"{out}: a {'sequence' if render else 'recording without images'} (README.md in it); `pilsim track {out}` tracks it"
        if render and draw_twin(motion, out) is not None:
            yield f"{out / 'twin.png'} shows a frame beside the source's"
        if render and len(alike := annotated_overlaps(motion, read_boxes(out))):
            yield f"overlap of {len(alike)} annotated boxes with the twin's: median IoU {np.sort(alike)[len(alike) // 2]:.3f}"
        people, frames, _ = motion.position.shape
        yield f"{people} people in {frames} frames, before {len(motion.cameras)} cameras"


def _write(made: SimulatedSequence, render: bool, area: Array | None, workers: int, out: Path) -> None:
    if not render:
        _write_without_images(made, out, area)
        return
    with drawing_workers(min(workers, made.scenario.frames)) as drawing:
        write_sequence(dataclasses.replace(made, workers=drawing), out, partial(progress_bar, desc="frames", unit="frame"))


def _write_without_images(made: SimulatedSequence, folder: Path, area: Array | None) -> None:
    """Write the twin as a recording: its boxes, by ray casting, and its truth. It has fixed cameras only, since the SLAM of rovers needs images.

    area (2, 2): lowest and highest x, y, m, in which people are reported, or None.
    """
    setup = make_setup(made.simulation, made.fixed)
    frames = raycast_frames(made.simulation, setup)
    detections: dict[str, dict[int, tuple[Array, Array]]] = {name: {} for name in setup.mounts}
    truth: dict[int, tuple[Ints, Array]] = {}
    visible: dict[int, Array] = {}
    for frame in progress_bar(frames, total=made.scenario.frames, desc="frames", unit="frame"):
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
