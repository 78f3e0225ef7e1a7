"""Opening a folder by what lies in it. This is the only place that knows all formats of sources."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from tracker.datasets.aicity import is_aicity, read_aicity
from tracker.datasets.jrdb import is_jrdb, read_jrdb
from tracker.datasets.pets2009 import is_pets, read_pets
from tracker.datasets.selection import selected
from tracker.datasets.source_options import SourceOptions, camera_named
from tracker.datasets.wildtrack import is_wildtrack, read_wildtrack
from tracker.formats.utias import is_utias
from tracker.io.resume import checksum
from tracker.recordings import Recording
from tracker.recordings.degradation import Degradation, degraded_boxes, noisy_boxes, projected_boxes
from tracker.recordings.folder import is_recording, read_boxes, read_recording
from tracker.recordings.images import VideoFile
from tracker.sequence.dataset import FILE as DATASET
from tracker.sequence.reader import read_sequence
from tracker.types import Sequence

PILSIM, UTIAS = "pilsim", "utias"


@dataclass(frozen=True)
class SourceFormat:
    """A format of sources.

    name: short, as in --json. title: what it is and by which files it is told. matches: whether a folder holds it.
    read: the reader of a recording, with `strict` of open_recording; None for a sequence of pilsim, and for UTIAS, which has robots alone.
    calibration: the file or folder with the cameras of a recording.
    """

    name: str
    title: str
    matches: Callable[[Path], bool]
    read: Callable[[Path, SourceOptions, bool], Recording] | None = None
    calibration: str = ""


def _is_sequence(path: Path) -> bool:
    return (path / "manifest.json").is_file()


FORMATS = (
    SourceFormat(PILSIM, "a sequence of pilsim (manifest.json)", _is_sequence),
    SourceFormat(
        "recording",
        "a recording of one's own (recording.json, detections/)",
        is_recording,
        lambda path, _, strict: read_recording(path, strict),
        "recording.json",
    ),
    SourceFormat(UTIAS, "a UTIAS set (Barcodes.dat)", is_utias),
    SourceFormat(
        "wildtrack",
        "WILDTRACK or MultiviewX (calibrations/, annotations_positions/)",
        is_wildtrack,
        lambda path, *_: read_wildtrack(path),
        "calibrations",
    ),
    SourceFormat("jrdb", "JRDB (labels_2d_stitched/, labels_3d/)", is_jrdb, lambda path, options, _: read_jrdb(path, options.projected is not None)),
    SourceFormat(
        "aicity",
        "AI City track 1 (calibration.json, ground_truth.json)",
        is_aicity,
        lambda path, _, strict: read_aicity(path, strict),
        "calibration.json",
    ),
    SourceFormat(
        "pets2009",
        "PETS 2009 (annotations/ or detections/, calibration/ in it or beside it)",
        is_pets,
        lambda path, options, _: read_pets(path, options),
        "calibration",
    ),
)
"""All formats, in the order in which a folder is compared with them."""
NAMED = 4
"""Sequences of a dataset that an error names."""


def is_pilsim(path: Path) -> bool:
    """Whether a folder is a sequence of pilsim or a dataset of them."""
    return _is_sequence(path) or (path / DATASET).is_file()


def format_of(path: Path) -> SourceFormat:
    """The format of a folder, or of a file of labels of JRDB. Raises ValueError, which lists all formats, where it is none of them."""
    if not path.exists():
        raise ValueError(f"{path}: no such folder")
    for form in FORMATS:
        if form.matches(path):
            return form
    if (path / DATASET).is_file() and (names := sorted(found.name for found in path.iterdir() if _is_sequence(found))):
        raise ValueError(f"{path}: is a dataset, needs one of its sequences: {', '.join(names[:NAMED])}{', …' if len(names) > NAMED else ''}")
    wrong = "is a file" if path.is_file() else "holds nothing that pilsim opens"
    raise ValueError(f"{path}: {wrong}, needs the folder of one of: {'; '.join(form.title for form in FORMATS)}")


def open_recording(path: Path, options: SourceOptions | None = None, strict: bool = True) -> Recording:
    """Open a folder of any format but pilsim's own sequences and UTIAS sets.

    strict: whether cameras must be above the ground; see also read_recording.
    Raises ValueError for an unknown folder, invalid content, and for options that do not fit it.
    """
    options, form = options or SourceOptions(), format_of(path)
    if form.read is None:
        raise ValueError(f"{path}: is {form.title}, needs a source with cameras and boxes: {', '.join(f.name for f in FORMATS if f.read)}")
    recording = form.read(path, options, strict)
    if strict:
        try:
            recording.check_heights()
        except ValueError as error:
            raise ValueError(f"{path / form.calibration}: {error}") from None
    return _with_options(path, recording, options)


def open_sequence(path: Path, options: SourceOptions | None = None) -> Sequence:
    """Open a folder of any format as the tracker takes it. Raises ValueError as open_recording, and for UTIAS sets, which have no cameras."""
    options, form = options or SourceOptions(), format_of(path)
    if form.name == UTIAS:
        raise ValueError(f"{path}: is {form.title}, which has robots and no cameras; `track` and `score` read it")
    if form.name == PILSIM:
        if options.degradation != Degradation() or options.projected is not None:
            raise ValueError(f"{path}: --degrade and --project are for recordings; generate the sequence with another detector")
        return selected(read_sequence(path), options)
    recording = open_recording(path, options)
    if options.pixels:
        recording = _of_images(path, recording)
    try:
        return recording.sequence(options.images)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


def _of_images(path: Path, recording: Recording) -> Recording:
    """The cameras of a recording that have images, without boxes; a recording without boxes and truth is as long as its shortest video."""
    if not recording.images:
        raise ValueError(f"{path}: no images, neither video/CAMERA.mp4 nor images/CAMERA/, of {', '.join(recording.cameras)}")
    recording = recording.choose([name for name in recording.cameras if name in recording.images])
    if not recording.frames:
        lengths = [source.frames() for source in recording.images.values() if isinstance(source, VideoFile)]
        recording = replace(recording, frames=min(lengths, default=0))
    return recording.with_detections({name: {} for name in recording.cameras})


def _with_options(path: Path, recording: Recording, options: SourceOptions) -> Recording:
    source = dict(recording.source)
    files = options.detection_files(list(recording.cameras))
    recording = recording.with_detections({name: read_boxes(file) for name, file in files.items()})
    if files:
        source["files"] = source.get("files", {}) | {file.name: checksum(file) for file in files.values()}
    if options.projected is not None:
        # JRDB has labelled boxes, of people who sit, too.
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
    return replace(recording, source=source)
