"""Reading a sequence of JRDB, or of the export `jrdb` of pilsim, as a recording in the frame of the robot.

    labels/labels_3d/SEQ.json                           optional truth: boxes in space, metres.
    labels/labels_2d_stitched/SEQ.json                  optional: boxes of the same people in the panorama.
    detections/detections_2d_stitched/SEQ.json          optional: a detector's boxes; or detections/SEQ.txt, MOT15, frames from 1.
    images/image_stitched/SEQ/000000.jpg                optional: panoramas.
    timestamps/SEQ/frames_img.json                      optional: times of the panoramas.

The parent folders `labels/` and `detections/` may be left out. The panorama of JRDB is a cylinder of 3760 x 480 px. Feet on the floor at a range
of r metres are in row 210.7 + 481 / r. The row depends only on the product of focal length and height above the floor. Box sizes separate the
two: a body of height h has 481 h / r rows. So the focal length is 481 px, and the camera is 1 m above the floor.

People are tracked in the camera's frame, lowered to the floor: x ahead, y left, z up. The layout has no odometry. Where the robot moves, standing
people seem to move, and paths in a fixed frame are unknown. Most people of JRDB sit: their boxes are 0.9 to 2.3 m high.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tracker.formats.jrdb.files import (
    DETECTIONS,
    LABELS_2D,
    LABELS_3D,
    Label2d,
    Label3d,
    PanoramaNote,
    read_detections_2d,
    read_labels_2d,
    read_labels_3d,
    read_note,
    read_times,
)
from tracker.geometry import Array, Ints, Pose
from tracker.geometry.cameras import Camera, Cylinder, Panorama
from tracker.io.image_files import PICTURES, image_size
from tracker.io.picture_folders import visible_files
from tracker.io.resume import checksum
from tracker.recordings import FrameBoxes, Recording, RecordingCamera
from tracker.recordings.clocks import CameraClock
from tracker.recordings.folder import read_boxes
from tracker.recordings.images import ImageFiles
from tracker.recordings.recording import MAX_FRAMES, STATURE

CAMERA = "panorama"
"""Name of the only camera."""
CYLINDER = Cylinder(3760, 480, 210.7, 481.0)
ABOVE_FLOOR = 1.0
"""m: height of JRDB's panorama."""
RATE = 15.0
"""Frames per second of JRDB's images; labels are of every n-th."""
SEATED = (0.9, 2.3)
"""m: band of heights of people who sit or stand."""
IMAGES = "images/image_stitched"


@dataclass(frozen=True)
class JrdbSequence:
    """The existing files of a sequence, by the names of their folders in JRDB. images: the folder of panoramas, or None."""

    name: str
    files: dict[str, Path]
    images: Path | None


def is_jrdb(path: Path) -> bool:
    """Whether a folder holds labels or detections of JRDB, or `path` is such a file of labels."""
    root, _ = _root(path)
    return any(True for folder in _folders(root, LABELS_3D, LABELS_2D, DETECTIONS) for _ in folder.glob("*.json"))


def jrdb_sequence(path: Path) -> JrdbSequence:
    """The sequence that a path names: a folder of one sequence, or the label file or image folder of one sequence among several.

    Raises ValueError where there is none, and with the first names where there are several.
    """
    root, wanted = _root(path)
    kinds = (LABELS_3D, LABELS_2D, DETECTIONS)
    found = {kind: {file.stem: file for folder in _folders(root, kind) for file in sorted(folder.glob("*.json"))} for kind in kinds}
    names = sorted({name for files in found.values() for name in files})
    if wanted is None and len(names) != 1:
        some = f"{len(names)} sequences ({', '.join(names[:3])}{', …' if len(names) > 3 else ''})" if names else "no sequence"
        example = next((file for files in found.values() for file in files.values()), root / LABELS_3D / "SEQ.json")
        raise ValueError(f"{path}: holds {some} of JRDB, needs one; name it by its file of labels, as {example}")
    name = wanted or names[0]
    files = {Path(kind).name: found[kind][name] for kind in kinds if name in found[kind]}
    beside = {"detections": root / "detections" / f"{name}.txt", "timestamps": root / "timestamps" / name / "frames_img.json"}
    files |= {kind: file for kind, file in beside.items() if file.is_file()}
    images = root / IMAGES / name
    return JrdbSequence(name, files, images if images.is_dir() else None)


def _root(path: Path) -> tuple[Path, str | None]:
    """The root of a data set and the sequence that `path` names in it, None for the root itself."""
    if path.suffix == ".json" and path.is_file():
        above = path.parent.parent
        return (above.parent if above.name == "labels" else above), path.stem
    if path.parent.name == "image_stitched" and path.parent.parent.name == "images":
        return path.parent.parent.parent, path.name
    return path, None


def _folders(root: Path, *kinds: str) -> list[Path]:
    """The existing folders of these kinds, with or without their parent folder."""
    return [folder for kind in kinds for folder in (root / kind, root / Path(kind).name) if folder.is_dir()]


def read_jrdb(path: Path, labels_as_detections: bool = False) -> Recording:
    """Read a sequence; see jrdb_sequence for `path`. labels_as_detections: whether labelled boxes with `visible` above 0 are the detections.

    The frames are the labelled images: every n-th, from the first, at 15 / n frames/s. Without labels they are the images with detections.
    Raises ValueError with file and field for missing or invalid content.
    """
    sequence = jrdb_sequence(path)
    files = sequence.files
    people = read_labels_3d(files["labels_3d"]) if "labels_3d" in files else None
    labels = read_labels_2d(files["labels_2d_stitched"]) if "labels_2d_stitched" in files else {}
    note = read_note(files["labels_2d_stitched"]) if "labels_2d_stitched" in files else None
    detected = read_detections_2d(files["detections_2d_stitched"]) if "detections_2d_stitched" in files else {}
    index, step = _index(people or labels or detected, path)
    boxes: FrameBoxes = {index[number]: found for number, found in detected.items() if number in index}
    if labels_as_detections:
        boxes = {index[number]: _boxes(found) for number, found in labels.items() if number in index}
    elif "detections" in files:
        boxes = read_boxes(files["detections"])
        _check_frames(boxes, index, files["detections"])
    images = {index[int(file.stem)]: file for file in _pictures(sequence.images) if int(file.stem) in index}
    above, frames = note.above_ground if note else ABOVE_FLOOR, max([*index.values(), *boxes], default=-1) + 1
    return Recording(
        note.rate if note else RATE / step,
        {CAMERA: RecordingCamera(_camera(note, images), Pose(np.eye(3), np.array([0.0, 0.0, above])))},
        {CAMERA: boxes} if boxes else {},
        None if people is None else {index[number]: _people(found, note) for number, found in people.items()},
        frames=frames,
        height=STATURE if note else SEATED,
        images={CAMERA: ImageFiles(images)} if images else {},
        clocks={CAMERA: _clock(files["timestamps"], [min(index) + step * k for k in range(frames)])} if "timestamps" in files and index else {},
        source={
            "source": "JRDB",
            "sequence": sequence.name,
            "labels_as_detections": labels_as_detections,
            "files": {kind: checksum(file) for kind, file in files.items()},
        },
    )


def _clock(file: Path, numbers: list[int]) -> CameraClock:
    """The stamps of the images with these numbers, relative to the first. Raises ValueError, with the file, for an image without a stamp."""
    times = read_times(file)
    if missing := [number for number in numbers if number not in times]:
        raise ValueError(f"{file}: has no time of image {missing[0]:06d}, which labels or detections have")
    try:
        return CameraClock(stamps={k: times[number] - times[numbers[0]] for k, number in enumerate(numbers)})
    except ValueError as error:
        raise ValueError(f"{file}: {error}") from None


def _index(numbers: Iterable[int], path: Path) -> tuple[dict[int, int], int]:
    """Numbers of images → frames from 0, and the step between frames: the greatest common divisor of the differences."""
    known = sorted(numbers)
    step = math.gcd(*(number - known[0] for number in known)) or 1 if known else 1
    if known and (known[-1] - known[0]) // step >= MAX_FRAMES:
        raise ValueError(f"{path}: frames are {known[0]} to {known[-1]} in steps of {step}, needs less than {MAX_FRAMES} of them")
    return {number: (number - known[0]) // step for number in known}, step


def _check_frames(boxes: FrameBoxes, index: Mapping[int, int], file: Path) -> None:
    """Raises ValueError for boxes after the last labelled frame. Such boxes are numbered by images, of which only every n-th is labelled."""
    last, labelled = max(boxes, default=-1), max(index.values(), default=-1)
    if index and last > labelled:
        raise ValueError(f"{file}: frame is {last + 1}, needs at most {labelled + 1}, the number of labelled frames; they count from 1 without gaps")


def _people(labels: Iterable[Label3d], note: PanoramaNote | None) -> tuple[Ints, Array]:
    """Ids and feet (k, 3) m; the last label of a repeated id counts. Feet are on the floor in JRDB, at the box's lower face in pilsim's export."""
    found = {one.person: one for one in labels}.values()
    ids = np.array([one.person for one in found], dtype=np.int64)
    places = np.array([one.centre - [0.0, 0.0, one.size[2] / 2] for one in found]).reshape(-1, 3)
    places[:, 2] = 0.0 if note is None else places[:, 2] + note.above_ground
    return ids, places


def _boxes(labels: Iterable[Label2d]) -> tuple[Array, Array]:
    seen = [one.seen for one in labels if one.visible > 0]
    return np.array(seen).reshape(-1, 4), np.ones(len(seen))


def _camera(note: PanoramaNote | None, images: Mapping[int, Path]) -> Camera:
    """The model of the images. Raises ValueError where the first image has another size."""
    if note is None:
        camera: Camera = CYLINDER
    elif note.horizon is not None and note.focal is not None:
        camera = Cylinder(note.width, note.height, note.horizon, note.focal)
    else:
        camera = Panorama(note.width, note.height)
    if images:
        first = images[min(images)]
        size = image_size(first.read_bytes())
        if size != (camera.height, camera.width):
            there = "no image that is read" if size is None else f"{size[1]} x {size[0]} px"
            raise ValueError(f"{first}: is {there}, needs {camera.width} x {camera.height} px")
    return camera


def _pictures(folder: Path | None) -> list[Path]:
    return [] if folder is None else [file for file in visible_files(folder, PICTURES) if re.fullmatch("[0-9]{1,12}", file.stem)]
