"""The command `view`: a sequence with tracks in the Rerun viewer, or as a Rerun recording.

Rerun is an optional dependency. It is imported on demand; without it, one line says what to install.
"""

from __future__ import annotations

import errno
import importlib
import os
import shutil
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import tee
from pathlib import Path
from typing import Any

import numpy as np

from sim.visualization.rerun_scene import RerunScene, SceneFrame
from tracker.formats.opening import format_of, open_recording, open_sequence
from tracker.formats.source_options import SourceOptions
from tracker.io.atomic import new_file
from tracker.io.file_lock import output_file_lock
from tracker.io.progress import progress_bar
from tracker.pipeline import track
from tracker.sequence.results import Results, read_results
from tracker.types import Estimate, Sequence

RESERVE = 16 << 20
"""Bytes that must be free on the disk before a frame is written."""


def rerun() -> Any:
    """The module `rerun`. Raises ValueError, which says what to install, if it is missing."""
    try:
        return importlib.import_module("rerun")
    except ImportError:
        raise ValueError('view needs Rerun, which is not installed: pip install "pilsim[view]" (or: pip install rerun-sdk)') from None


def show(folder: Path, results: Path | None = None, tracked: bool = False, save: Path | None = None) -> None:
    """Open the viewer on a sequence, or write a recording to the file `save` atomically.

    folder: a source, or a folder with `sequence` and `track` in it. results: a folder of tracks, or None. tracked: run the tracker instead.
    Raises ValueError without Rerun or a screen, for a file name that does not end in .rrd, and for files that cannot be read.
    """
    module = rerun()
    if save is not None and save.suffix != ".rrd":
        raise ValueError(f"--save is {save}, needs a name that ends in .rrd")
    source, given = _sequence_and_tracks(folder, results)
    format_of(source)
    if save is None and sys.platform == "linux" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise ValueError("there is no screen here for the viewer: give --save FILE.rrd, and open that elsewhere with `rerun FILE.rrd`")
    if tracked and results is not None:
        raise ValueError("--results and --track exclude each other: tracks are read, or made now")
    read = read_results(given) if given is not None and not tracked else None
    sequence = open_sequence(source, _with_images(source, SourceOptions.of_run(read.run) if read else SourceOptions()))
    if read is not None and read.run.get("provenance", sequence.provenance) != sequence.provenance:
        raise ValueError(f"{given}: these tracks were made from another source than {source}")
    stream = module.RecordingStream("pilsim")
    scene = RerunScene(module, stream, sequence)
    frames = _tracked_now(sequence) if tracked else _with_results(sequence, read)
    if save is None:
        stream.spawn(default_blueprint=scene.blueprint())
        _play(scene, frames)
        return
    with output_file_lock(save):
        _write(scene, frames, save)


def _write(scene: RerunScene, frames: Iterator[SceneFrame], save: Path) -> None:
    def check_space() -> None:
        if shutil.disk_usage(Path(os.path.realpath(save)).parent).free < RESERVE:
            raise OSError(errno.ENOSPC, f"{os.strerror(errno.ENOSPC)} (less than {RESERVE >> 20} MiB are free)", str(save))

    with new_file(save) as part:
        # Rerun waits without end where the disk is full.
        check_space()
        scene.stream.save(part, default_blueprint=scene.blueprint())
        _play(scene, frames, check_space)
        scene.stream.flush()
        scene.stream.disconnect()
    print(f"{save}: {len(scene.sequence.ticks)} frames, {save.stat().st_size / 1e6:.1f} MB; `rerun {save}` opens it")


def _with_images(source: Path, options: SourceOptions) -> SourceOptions:
    """The options with the images of a recording that has some. Sequences of pilsim always have theirs."""
    there = format_of(source).read is not None and bool(open_recording(source, options).images)
    return replace(options, images=there)


def _sequence_and_tracks(folder: Path, results: Path | None) -> tuple[Path, Path | None]:
    """Folders of the sequence and of the tracks that `folder` refers to."""
    if (folder / "sequence").is_dir():
        beside = folder / "track"
        return folder / "sequence", results or (beside if beside.is_dir() else None)
    return folder, results


def _play(scene: RerunScene, frames: Iterator[SceneFrame], check: Callable[[], None] = lambda: None) -> None:
    """Show all frames. check: is called before each."""
    scene.log_static()
    for one in progress_bar(frames, total=len(scene.sequence.ticks), desc="frames", unit="frame"):
        check()
        scene.log_frame(one)


def read_frame(results: Results, k: int) -> Estimate:
    """The estimate of frame k from the files of a run. Covariances of targets are 0, because the files do not hold them."""
    ids, places = results.tracks.get(k, (np.zeros(0, dtype=np.int64), np.zeros((0, 3))))
    poses = {robot: pose for robot, of_robot in results.poses.items() if (pose := of_robot[k]) is not None}
    spread = {robot: P for robot, of_robot in results.covariances.items() if (P := of_robot[k]) is not None}
    return replace(Estimate.of_robots(k, poses, spread, {}), target_id=ids, position=places, covariance=np.zeros((len(ids), 3, 3)))


def _with_results(sequence: Sequence, read: Results | None) -> Iterator[SceneFrame]:
    """Each tick with the estimate in the files of a run, where there are some."""
    for tick in sequence.ticks:
        yield SceneFrame(tick, None if read is None else read_frame(read, tick.index))


def _tracked_now(sequence: Sequence) -> Iterator[SceneFrame]:
    """Run the tracker, and yield each tick with its estimate."""
    # Estimates come later than their ticks, which are kept meanwhile.
    read, shown = tee(sequence.ticks)
    for estimate in track(sequence.setup, read):
        yield SceneFrame(next(shown), estimate)
