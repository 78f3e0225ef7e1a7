"""Opening a source of any format. The files in its folder identify the format (tracker/formats/registry.py)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from itertools import islice
from pathlib import Path

import numpy as np

from tracker.detections.boxes import detections_from_boxes, feet_seen
from tracker.formats.registry import PILSIM, SOURCES, UTIAS, Format, is_sequence
from tracker.formats.ros.bag_reader import is_bag
from tracker.formats.source_options import SourceOptions, camera_named
from tracker.io.mot15 import VISIBLE_FILE
from tracker.io.picture_folders import content_checksum
from tracker.io.resume import checksum
from tracker.io.time_order import say
from tracker.recordings import FrameBoxes, Recording
from tracker.recordings.calibration_check import suspicion
from tracker.recordings.clock_offsets import AUTO, estimated_offsets, parsed_offsets, with_offsets
from tracker.recordings.degradation import Degradation, degraded_boxes, noisy_boxes, projected_boxes
from tracker.recordings.folder import read_boxes, read_visible_parts
from tracker.recordings.images import VideoFile
from tracker.recordings.recording import FrameVectors
from tracker.sequence.dataset import FILE as DATASET
from tracker.sequence.dataset import MANIFEST
from tracker.sequence.reader import read_sequence
from tracker.types import Odometry, Sequence, Setup, Tick, Ticks, Truth, View

NAMED = 4
"""Number of sequences of a dataset that an error names."""


def is_pilsim(path: Path) -> bool:
    """Whether a folder is a sequence of pilsim or a dataset of them."""
    return is_sequence(path) or (path / DATASET).is_file()


def format_of(path: Path) -> Format:
    """The format of a folder, or of a file of labels of JRDB. Raises ValueError, which lists all formats, where it is none of them."""
    if not path.exists():
        raise ValueError(f"{path}: no such folder")
    for form in SOURCES:
        if form.matches(path):
            return form
    if (path / DATASET).is_file() and (names := sorted(found.name for found in path.iterdir() if is_sequence(found))):
        raise ValueError(f"{path}: is a dataset, needs one of its sequences: {', '.join(names[:NAMED])}{', …' if len(names) > NAMED else ''}")
    if is_bag(path):
        raise ValueError(f"{path}: is a bag, of which `pilsim import` makes a recording; `pilsim info` lists its topics")
    wrong = "is a file" if path.is_file() else "holds nothing that pilsim opens"
    raise ValueError(f"{path}: {wrong}, needs the folder of one of: {'; '.join(form.title for form in SOURCES)}")


def open_recording(path: Path, options: SourceOptions | None = None, strict: bool = True) -> Recording:
    """Open a folder of any format but pilsim's own sequences and UTIAS sets.

    strict: whether cameras must be above the ground; see also read_recording.
    Raises ValueError for an unknown folder, invalid content, and for options that do not fit it.
    """
    options, form = options or SourceOptions(), format_of(path)
    if form.read is None:
        raise ValueError(f"{path}: is {form.title}, needs a source with cameras and boxes: {', '.join(f.name for f in SOURCES if f.read)}")
    recording = form.read(path, options, strict)
    if strict:
        try:
            recording.check_heights()
        except ValueError as error:
            raise ValueError(f"{path / form.calibration}: {error}") from None
    return _with_options(path, recording, options)


def open_sequence(path: Path, options: SourceOptions | None = None, checked: bool = False, calibrated: bool = True) -> Sequence:
    """Open a folder of any format as the input of the tracker. checked: whether errors that `pilsim check` finds are logged (say_suspicion).

    calibrated: whether all cameras need poses; finding people in images needs none.

    Raises ValueError as open_recording, and for UTIAS sets, which have no cameras.
    """
    options, form = options or SourceOptions(), format_of(path)
    if form.name == UTIAS:
        raise ValueError(f"{path}: is {form.title}, which has robots and no cameras; `track` and `score` read it")
    if form.name == PILSIM:
        if options.offsets:
            raise ValueError(f"{path}: --offsets is for recordings; the clocks of a sequence of pilsim are known")
        if options.degradation != Degradation() or options.projected is not None:
            raise ValueError(f"{path}: --degrade and --project are for recordings; generate the sequence with another detector")
        return selected(read_sequence(path), options)
    recording = open_recording(path, options)
    if options.pixels:
        recording = _of_images(path, recording)
    elif checked and not any(camera.unknown for camera in recording.cameras.values()):
        say_suspicion(path, recording)
    try:
        return recording.sequence(options.images, calibrated)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


def say_suspicion(path: Path, recording: Recording) -> None:
    """Log in one line what `pilsim check` finds wrong with the boxes, places and frame numbers of a recording; nothing where it finds no error."""
    if found := suspicion(recording):
        say(f"{path}: something is wrong with the input ({found}); `pilsim check {path}` tells more")


def images_checksum(path: Path, options: SourceOptions) -> str:
    """A checksum of a source's images for the chosen cameras and frames. A finished run stores it to detect other images."""
    if format_of(path).name == PILSIM:
        return checksum(path / MANIFEST)
    recording = open_recording(path, replace(options, detections={}, projected=None, degradation=Degradation()))
    return content_checksum(file for source in recording.images.values() for file in source.paths())


def _of_images(path: Path, recording: Recording) -> Recording:
    """The cameras of a recording that have images, without boxes. If no data give the number of frames, the shortest video does."""
    if not recording.images:
        raise ValueError(f"{path}: no images, neither video/CAMERA.mp4 nor images/CAMERA/000001.jpg, of {', '.join(recording.cameras)}")
    recording = recording.choose([name for name in recording.cameras if name in recording.images])
    if not recording.frames:
        lengths = [source.frames() for source in recording.images.values() if isinstance(source, VideoFile)]
        # Without data in the frames of the recording, those of the cameras that are left count.
        recording = replace(recording, frames=min(lengths, default=0), stamps=None)
    return recording.with_detections({name: {} for name in recording.cameras})


def _with_options(path: Path, recording: Recording, options: SourceOptions) -> Recording:
    source = dict(recording.source)
    files = options.detection_files(list(recording.cameras))
    recording = recording.with_detections({name: read_boxes(file) for name, file in files.items()})
    visible = {name: parts for name, file in files.items() if (parts := read_visible_parts(file))}
    recording = replace(recording, visible_parts={**recording.visible_parts, **visible})
    if files:
        beside = [file.with_name(file.stem + VISIBLE_FILE) for name, file in files.items() if name in visible]
        source["files"] = source.get("files", {}) | {file.name: checksum(file) for file in (*files.values(), *beside)}
    if options.projected is not None:
        # JRDB has labelled boxes, which also fit people who sit.
        made = noisy_boxes if recording.source.get("labels_as_detections") else projected_boxes
        recording = made(recording, options.projected, options.seed)
        source = dict(recording.source)
    if options.cameras:
        recording = recording.choose([camera_named(text, recording.cameras) for text in options.cameras])
    if options.frames is not None:
        first, end = options.frames
        if first >= recording.frames:
            raise ValueError(f"--frames is {first}:{'' if end is None else end}, needs a first frame below {recording.frames}, all that {path} has")
        recording = recording.cut(first, recording.frames if end is None else min(end, recording.frames))
        source["frames"] = [first, first + recording.frames]
    if options.degradation != Degradation():
        try:
            recording = degraded_boxes(recording, options.degradation, options.seed)
        except ValueError as error:
            raise ValueError(f"{path}: {error}") from None
        source |= {"degradation": asdict(options.degradation), "seed": options.seed}
    if options.offsets:
        recording = _with_clock_offsets(path, recording, options.offsets)
    return replace(recording, source=source)


def _with_clock_offsets(path: Path, recording: Recording, text: str) -> Recording:
    """The recording with the clock offsets of --offsets. Estimated offsets are logged in one line."""
    if text != AUTO:
        return with_offsets(recording, parsed_offsets(text, list(recording.cameras)))
    found = estimated_offsets(recording)
    late = ", ".join(f"{name} {abs(seconds):.2f} s {'late' if seconds > 0 else 'early'}" for name, seconds in found.items())
    say(f"{path}: clocks by people who move: {late or 'no camera is clearly apart from the others'}")
    return with_offsets(recording, found)


@dataclass(frozen=True, eq=False)
class SelectedTicks:
    """Ticks from `first` to `end` − 1 with the cameras of `setup` alone.

    detections: camera → boxes that replace its own. visible: camera → the visible parts of these boxes, where they are known.
    """

    ticks: Ticks
    setup: Setup
    first: int
    end: int
    detections: dict[str, FrameBoxes]
    visible: dict[str, FrameVectors]

    def __len__(self) -> int:
        return self.end - self.first

    def __iter__(self) -> Iterator[Tick]:
        for tick in islice(self.ticks, self.first, self.end):
            views = tuple(self._view(view, tick.index) for view in tick.views if view.camera in self.setup.mounts)
            index = tick.index - self.first
            yield Tick(index, index * self.setup.period, views)

    def _view(self, view: View, frame: int) -> View:
        seen = view.robot_detections
        if seen is not None:
            view = replace(view, robot_detections=seen.choose(self.setup.starts))
        if view.camera not in self.detections:
            return view
        boxes, confidence = self.detections[view.camera].get(frame, (np.zeros((0, 4)), np.zeros(0)))
        found = detections_from_boxes(self.setup.mounts[view.camera].camera, boxes, confidence)
        if (parts := self.visible.get(view.camera, {}).get(frame)) is not None:
            found = replace(found, feet_seen=feet_seen(boxes, parts))
        return replace(view, detections=found)

    def odometry(self) -> Iterator[dict[str, Odometry]]:
        for moved in islice(self.ticks.odometry(), self.first, self.end):
            yield {robot: odometry for robot, odometry in moved.items() if robot in self.setup.starts}


def selected(sequence: Sequence, options: SourceOptions) -> Sequence:
    """The part of a sequence that `options` choose; the sequence itself where they choose all of it.

    Raises ValueError for an unknown camera, for missing frames, and for a first frame other than 0 where robots move.
    """
    if not options.cameras and options.frames is None and not options.detections:
        return sequence
    mounts = sequence.setup.mounts
    names = [camera_named(text, mounts) for text in options.cameras] or list(mounts)
    kept = {name: mounts[name] for name in mounts if name in names}
    carriers = {mount.robot for mount in kept.values()}
    setup = replace(sequence.setup, mounts=kept, starts={name: start for name, start in sequence.setup.starts.items() if name in carriers})
    first, end = options.frames or (0, None)
    end = len(sequence.ticks) if end is None else min(end, len(sequence.ticks))
    if not 0 <= first < end:
        raise ValueError(f"--frames begins at {first}, needs a first frame below {len(sequence.ticks)}, all that the sequence has")
    if first and setup.moving_robots:
        raise ValueError(f"--frames begins at {first}, needs 0 where robots move, since their start is known at frame 0 alone")
    files = options.detection_files(list(kept))
    detections: dict[str, FrameBoxes] = {name: read_boxes(file) for name, file in files.items()}
    visible: dict[str, FrameVectors] = {name: read_visible_parts(file) for name, file in files.items()}
    columns = [list(mounts).index(name) for name in kept]
    truth = None if sequence.truth is None else tuple(_of_truth(t, t.index - first, setup, columns) for t in sequence.truth[first:end])
    provenance = sequence.provenance | {"cameras": list(kept), "frames": [first, end]}
    return Sequence(setup, SelectedTicks(sequence.ticks, setup, first, end, detections, visible), truth, provenance)


def _of_truth(truth: Truth, index: int, setup: Setup, columns: list[int]) -> Truth:
    poses = {robot: pose for robot, pose in truth.T_world_robot.items() if robot in setup.starts}
    return replace(truth, index=index, T_world_robot=poses, visible=truth.visible[:, columns], tipped=truth.tipped & poses.keys())
