"""Generation of the twin of any source, rendered as a sequence, or without images as a recording."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np

from sim.datasets.raycast_recording import write_raycast_recording
from sim.datasets.twin import annotated_overlaps, recording_of
from sim.datasets.twin_picture import draw_twin
from sim.datasets.twin_sources import Twin, true_motion
from sim.parallel.pool import Pool, usable_cores
from sim.recording.drawing_workers import drawing_workers
from sim.recording.record import SimulatedSequence, check_absent, write_sequence
from tracker.geometry import Array
from tracker.io.file_lock import folder_lock
from tracker.io.progress import progress_bar
from tracker.sequence.truth_tables import read_boxes


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
