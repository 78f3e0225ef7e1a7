"""Generation of the twin of any source, rendered as a sequence, or without images as a recording."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from sim.datasets import pets_twin
from sim.datasets.pets_twin import Twin, annotations_of, box_overlaps
from sim.datasets.recorded_twin import RecordedTwin, TrueMotion, recording_of, true_motion
from sim.datasets.twin_picture import draw_pets_twin, draw_recorded_twin
from sim.parallel.pool import Pool, usable_cores
from sim.recording.drawing_workers import drawing_workers
from sim.recording.frames import raycast_frames
from sim.recording.record import SimulatedSequence, check_absent, write_sequence
from sim.recording.tracker_setup import make_setup
from tracker.detections.boxes import boxes_of_detections
from tracker.formats.opening import format_of
from tracker.formats.pets2009 import PETS_AREA, calibration_of
from tracker.geometry import Array, Ints
from tracker.io.atomic import new_folder, write_text
from tracker.io.file_lock import folder_lock
from tracker.io.json_files import json_text
from tracker.io.progress import progress_bar
from tracker.recordings import FrameBoxes, Recording, RecordingCamera
from tracker.recordings.folder import write_recording

PETS = "pets2009"
README = """# A twin without images, by pilsim

    recording.json          rate [1/s], area [m], ground [terrain.npz], height [m], frames, and the cameras (OpenCV, x_camera = R x_world + t [m])
    detections/CAMERA.txt   MOT15, frames from 1: frame, -1, left, top, width, height [px], confidence, -1, -1, -1
    truth.txt               MOT15, frames from 1: frame, id, -1, -1, -1, -1, visible share, x, y, z [m, the ground under the body]
    scenario.json           how it was made: the scenario, and the source under `twin`
"""


@dataclass(frozen=True)
class TwinOrder:
    """What twin is wanted: of the folder `source`, or of a PETS 2009 annotation file and a folder of calibrations.

    views: names or numbers of cameras, parted by commas, or None. changes: fields of Twin or RecordedTwin that differ from their defaults.
    render: False for a recording without images. workers: number of processes that draw, None for one a core.
    """

    source: Path | None
    annotations: Path | None
    calibration: Path | None
    views: str | None
    changes: Mapping[str, Any]
    render: bool = True
    workers: int | None = None


def generate_twin(order: TwinOrder, out: Path) -> Iterator[str]:
    """Write the twin into the new folder `out`, and yield lines that say what there is. Raises ValueError, in one line, for invalid sources."""
    if (order.source is None) == (order.annotations is None) or (order.annotations is None) != (order.calibration is None):
        raise ValueError("a twin needs SOURCE, or --annotations FILE and --calibration DIR")
    if not order.render and (robots := order.changes.get("robots")):
        raise ValueError(f"robots is {robots}, needs 0 without rendering: the SLAM of rovers needs images")
    check_absent(out)
    workers = Pool(usable_cores() if order.workers is None else order.workers).workers
    # A folder that cannot be written is named before the sources are read.
    with folder_lock(out):
        yield from _generate(order, workers, out)


def _generate(order: TwinOrder, workers: int, out: Path) -> Iterator[str]:
    if order.source is None or format_of(order.source).name == PETS:
        yield from _generate_pets(order, _pets(order), workers, out)
        return
    names = tuple(text.strip() for text in (order.views or "").split(",") if text.strip())
    twin = dataclasses.replace(RecordedTwin(order.source, names), **order.changes)
    motion = true_motion(twin)
    _write(recording_of(twin, motion), order.render, motion.area, workers, out)
    yield from _described(out, order.render)
    if order.render and draw_recorded_twin(motion, out) is not None:
        yield f"{out / 'twin.png'} shows a frame beside the source's"
    yield _extent(motion)


def _pets(order: TwinOrder) -> Twin:
    """The twin of PETS 2009 that is wanted. Raises ValueError for numbers of views that are none, and for a source without annotations."""
    annotations, calibration, source = order.annotations, order.calibration, order.source
    if source is not None:
        annotations, calibration = annotations_of(source), calibration_of(source)
    assert annotations is not None
    assert calibration is not None
    numbers = [text.strip().lower().removeprefix("view_") for text in (order.views or "1").split(",") if text.strip()]
    if not all(text.isdecimal() for text in numbers):
        raise ValueError(f"--views is {order.views!r}, needs numbers as in 1,5,7")
    changes = dict(order.changes)
    if changes.pop("difficulty", 0.0):
        raise ValueError("--difficulty is for halls; the campus of a twin of PETS 2009 is flat, as the site is")
    if not order.render:
        changes = {"robots": 0} | changes
    return dataclasses.replace(Twin(annotations, calibration, tuple(int(text) for text in numbers)), **changes)


def _generate_pets(order: TwinOrder, twin: Twin, workers: int, out: Path) -> Iterator[str]:
    _write(pets_twin.recording_of(twin), order.render, np.array(PETS_AREA), workers, out)
    yield from _described(out, order.render)
    if order.render and pets_twin.ANNOTATED in twin.views:
        draw_pets_twin(twin, out)
        alike = sorted(box_overlaps(twin, out).tolist())
        median = alike[len(alike) // 2]
        yield f"overlap of {len(alike)} annotated boxes with the twin's in View_001: median IoU {median:.3f} (twin.png shows a frame)"


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
    setup = make_setup(made.scenario, made.simulation, made.fixed)
    frames = raycast_frames(made.scenario, made.simulation, setup)
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


def _described(out: Path, render: bool) -> Iterator[str]:
    yield f"{out}: a {'sequence' if render else 'recording without images'} (README.md in it); `pilsim track {out}` tracks it"


def _extent(motion: TrueMotion) -> str:
    people, frames, _ = motion.position.shape
    return f"{people} people in {frames} frames, before {len(motion.cameras)} cameras"
