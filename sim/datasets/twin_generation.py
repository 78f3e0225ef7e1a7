"""Generation of the twin of any source, rendered as a sequence with a picture beside the source, or without images as a recording."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from functools import partial
from itertools import islice
from pathlib import Path

import cv2
import numpy as np

from sim.datasets.raycast_recording import write_raycast_recording
from sim.datasets.twin import annotated_overlaps, recording_of
from sim.datasets.twin_sources import TrueMotion, Twin, true_motion
from sim.parallel.pool import Pool, usable_cores
from sim.recording.drawing_workers import drawing_workers
from sim.recording.record import SimulatedSequence, check_absent, write_sequence
from sim.visualization.overlays import colour_of, save_png
from tracker.geometry import Array, Image, Ints
from tracker.io.file_lock import folder_lock
from tracker.io.progress import progress_bar
from tracker.sequence.reader import read_sequence
from tracker.sequence.truth_tables import read_boxes
from tracker.types import Boxes

DARK = 24
"""Grey value of the margins."""


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
        write_raycast_recording(made, out, area)
        return
    with drawing_workers(min(workers, made.scenario.frames)) as drawing:
        write_sequence(dataclasses.replace(made, workers=drawing), out, partial(progress_bar, desc="frames", unit="frame"))


def draw_twin(motion: TrueMotion, folder: Path) -> Path | None:
    """Write `twin.png` into the twin's folder and return its path, or None where the source has neither boxes nor images of its cameras and frames.

    The left image is the twin's, the right one the source's, where there is one. Boxes of both are annotated ones of the source, where these are
    known; the twin's own boxes of whole bodies are then thick. Otherwise both have the true boxes of the twin.
    View and frame are those with most people. Raises ValueError where an image of the source cannot be read.
    """
    own = read_boxes(folder)
    shown = motion.boxes or {key: (boxes.person, boxes.full) for key, boxes in own.items() if key[1] in motion.images}
    for frame, name in sorted(shown, key=lambda key: (-len(shown[key][0]), key)):
        camera, (ids, edges) = motion.cameras[name].camera, shown[frame, name]
        source = motion.images.get(name)
        real = None if source is None else next(source.cut(frame, frame + 1).images(1, (camera.height, camera.width)), None)
        if real is None and not motion.boxes:
            continue
        thin, image, note = max(1, camera.width // 900), _image_of(folder, frame, name), "the twin's true boxes"
        if motion.boxes:
            boxes, note = own.get((frame, name), Boxes.none()), "annotated boxes"
            image = _boxed(image, boxes.person, boxes.full, 2 * thin)
        pictures = [_titled(_boxed(image, ids, edges, thin), f"twin, {name}, frame {frame}{': own boxes thick' if motion.boxes else ''}")]
        pictures += [] if real is None else [_titled(_boxed(real, ids, edges, thin), f"the source, with {note}")]
        padded = [cv2.copyMakeBorder(p, 0, 0, 0, 6, cv2.BORDER_CONSTANT, value=(DARK,) * 3).astype(np.uint8) for p in pictures]
        save_png(folder / "twin.png", np.hstack(padded))
        return folder / "twin.png"
    return None


def _image_of(folder: Path, frame: int, camera: str) -> Image:
    tick = next(islice(read_sequence(folder).ticks, frame, None))
    image = next(view.image for view in tick.views if view.camera == camera)
    assert image is not None
    return image


def _boxed(image: Image, ids: Ints, boxes: Array, thickness: int) -> Image:
    """A copy of the image with boxes (n, 4): left, top, right, bottom, px, in the colours of their people."""
    out = np.ascontiguousarray(image).copy()
    for person, edges in zip(ids.tolist(), boxes.tolist(), strict=True):
        left, top, right, bottom = (round(edge) for edge in edges)
        cv2.rectangle(out, (left, top), (right - 1, bottom - 1), colour_of(person), thickness)
    return out


def _titled(image: Image, title: str) -> Image:
    """The image under a line of text."""
    out = cv2.copyMakeBorder(image, 30, 0, 0, 0, cv2.BORDER_CONSTANT, value=(DARK,) * 3)
    cv2.putText(out, title, (8, 21), cv2.FONT_HERSHEY_SIMPLEX, 0.55, (235, 235, 235), 1, cv2.LINE_AA)
    return np.asarray(out, dtype=np.uint8)
