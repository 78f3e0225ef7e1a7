"""The folder of a recording: recording.json, detections, optional truth, images, videos and robots; reader and writer.

* recording.json: rate and cameras; optional format, area, ground, height, frames, searched and pillars.
  searched: [[first, last], [first, last, step], ...], frames from 1 in which people were searched, or an object of camera → such a list. In
  other frames it is unknown whether people are there. Without the field, all frames were searched.
  pillars: [[x, y, radius, low, high], ...] m, upright cylinders that occlude people.
* detections/CAMERA.txt (MOT15): frame from 1, -1, left, top, width, height [px], confidence, -1, -1, -1.
* detections/CAMERA.covariance.npy (optional): c00, c01, c11 [rad²] of each box, the covariance of Detections (rows, 3), in the order of the rows.
* detections/CAMERA.visible.txt (optional, MOT15): the visible part of each box, as `pilsim detect` writes it. It has a row for each row of
  CAMERA.txt, frame by frame in the same order. The share of the body that is seen stands in place of the confidence.
* robot_detections.csv (optional): other robots that a camera sees: frame from 1, and the columns of companions.csv of a sequence.
* detections/CAMERA.npy (optional): appearance vectors of the boxes, an array (rows, d) of floating-point numbers, a row for each row of
  CAMERA.txt in the same order. They are compared by their cosine: length and scale do not matter. A row of zeros holds no information.
* truth.txt (MOT15, optional): frame from 1, id, -1, -1, -1, -1, visible share, x, y, z [m]. People with share 0 are not scored.
* video/CAMERA.mp4 (optional): one image for each frame; also .avi, .mkv, .mov, .webm, .m4v and .mpg.
* times.csv (optional): camera, frame from 1, time_s: the time of each frame of a camera. Frames without a row were not taken. A camera without
  rows has the rate of the recording, or its own "rate" and "offset_s" in recording.json. Then frame f is at offset_s + (f - 1) / rate.
* images/CAMERA/000001.jpg (optional, in place of the video): frames from 1, or from 0 where a camera has 000000; names as frame_000001.jpg and
  suffixes .jpeg, .png, .bmp, .tif, .tiff and .webp are read, too. Files that are left out are logged.
* robots.json (optional): robots that carry cameras: {"r0": {"start": {"position": [x, y, z] m, "quaternion": [w, x, y, z]}}}; a start may have
  "covariance" (6, 6) of [translation m, rotation rad] along the robot's axes, and is null where it is unknown.
* odometry.csv (with robots), with this header, a row for each robot and frame from 2: frame, robot, x, y, z [m], qw, qx, qy, qz, up_x, up_y, up_z,
  up_sigma [rad], c00, c01, ... c05, c11, ... c55. x to qz: the pose of the robot's body in that of the frame before. up: the direction of up
  along the robot's axes, 0, 0, 0 where unknown, and its error. cij: upper triangle of the covariance (6, 6) of [translation m, rotation rad].
* robot_truth.csv (optional, with robots): frame from 1, robot, x, y, z [m], qw, qx, qy, qz: true poses T_world_robot.
"""

from __future__ import annotations

import re
import shutil
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from tracker.geometry import Array, Ints, Mask, Pose
from tracker.geometry.ground import Flat, Ground
from tracker.io.atomic import new_file
from tracker.io.csv_tables import read_terrain, rows_by_frame, write_table
from tracker.io.image_files import encoded
from tracker.io.json_files import JsonObject, read_json, write_json
from tracker.io.mot15 import (
    VISIBLE_FILE,
    Mot15Rows,
    different_rows,
    place_of_row,
    read_detections,
    read_mot15,
    rows_from_boxes,
    rows_from_tracks,
    write_mot15,
)
from tracker.io.picture_folders import say_left_out
from tracker.io.resume import checksums
from tracker.io.time_order import say
from tracker.recordings.camera_json import camera_from, camera_to
from tracker.recordings.clocks import FILE as TIMES
from tracker.recordings.clocks import CameraClock, clock_fields, clock_from, read_times, uneven_clock, write_times
from tracker.recordings.images import ImageFiles, ImageSource, VideoFile, image_sources
from tracker.recordings.recording import MAX_FRAMES, OF_BOXES, STATURE, FrameBoxes, FrameVectors, Recording, RecordingCamera, RecordingRobot
from tracker.sequence.calibration import MAX_RATE, MIN_RATE, pose_from, pose_row
from tracker.sequence.reader import odometry_from, read_robot_detections
from tracker.sequence.schema import ODOMETRY, POSE, ROBOT_DETECTIONS
from tracker.sequence.writer import odometry_row, robot_detection_rows
from tracker.types import RobotDetections, Start

FILE = "recording.json"
FORMAT = "pilsim-recording/1"
ROBOT_TRUTH, ROBOTS_SEEN, COVARIANCES = "robot_truth.csv", "robot_detections.csv", ".covariance.npy"
KEYS = ("format", "rate", "area", "ground", "height", "frames", "searched", "pillars", "cameras")
PILLAR = "rows of x, y, radius, low and high in metres, radius over 0 and low under high"
OUTSIDE = 1.0
"""m: true people may be this far outside the area. A larger distance indicates a wrong unit or a wrong area."""
START_SIGMA = 1e-3
"""m and rad: standard deviation of a robot's start pose that has no covariance."""
MAX_CAMERAS = 1000
CAMERA_NAME = r"[^\s/\\,=:]{1,100}"
LONGEST_VECTOR = 4096
"""Most numbers of an appearance vector."""
QUALITY = 95
"""JPEG quality of images that are taken from a video."""


def is_recording(path: Path) -> bool:
    """Whether a folder holds recording.json."""
    return (path / FILE).is_file()


def read_recording(path: Path, strict: bool = True) -> Recording:
    """Read a recording. strict: whether truth must lie in the area and within the frames of the cameras; `pilsim check` omits this test.

    Raises ValueError with file and field or line for missing or invalid content.
    """
    file = path / FILE
    content, entries = _content(file)
    cameras = {name: camera_from(entry, f"{file}: cameras.{name}") for name, entry in entries.items()}
    detections, (ground, occluders) = _detections(path, cameras), _ground(path, content)
    low, high = content.array("height", (2,), meaning="metres, the lower first").tolist() if "height" in content.values else STATURE
    robots, images = _robots(path), image_sources(path, cameras)
    try:
        recording = Recording(
            content.number("rate", MIN_RATE, MAX_RATE, "frames per second"),
            cameras,
            detections,
            frames=content.whole("frames", 0, MAX_FRAMES) if "frames" in content.values else 0,
            area=content.values.get("area"),
            ground=ground,
            height=(low, high),
            occluders=occluders,
            pillars=pillars_from(content),
            images=images,
            robots=robots,
            clocks=_clocks(path, entries, images, detections),
            searched=_searched(content.values.get("searched"), cameras, f"{file}: searched"),
            appearances=_of_boxes(path / "detections", list(cameras), ".npy"),
            covariances=_of_boxes(path / "detections", list(cameras), COVARIANCES),
            visible_parts={name: parts for name in cameras if (parts := read_visible_parts(path / "detections" / f"{name}.txt"))},
            source={"source": "recording", "cameras": list(cameras), "files": _checksums(path)},
        )
    except ValueError as error:
        raise ValueError(str(error) if str(error).startswith(f"{path}") else f"{file}: {error}") from None
    if strict:
        try:
            recording.check_heights()
        except ValueError as error:
            raise ValueError(f"{file}: {error}") from None
        if (path / ROBOTS_SEEN).is_file():
            recording = replace(recording, robot_detections=_robots_seen(path / ROBOTS_SEEN, recording))
    return _with_truth(path, recording, strict)


def _clocks(path: Path, entries: Mapping[str, Any], images: Mapping[str, ImageSource], boxes: Mapping[str, FrameBoxes]) -> dict[str, CameraClock]:
    """The clocks of cameras: of times.csv, of recording.json, or of a video whose frames are not evenly spaced in time."""
    told = {name: clock for name, entry in entries.items() if (clock := clock_from(entry, f"cameras.{name}")) is not None}
    stamped = read_times(path / TIMES, entries) if (path / TIMES).is_file() else {}
    if both := sorted(set(told) & set(stamped)):
        raise ValueError(f"cameras.{both[0]} has offset_s or rate, and {TIMES} has its times; needs one of them")
    uneven = {}
    for name, source in images.items():
        if not isinstance(source, VideoFile) or name in told or name in stamped:
            continue
        if (clock := uneven_clock(source.path, boxes.get(name, ()))) is not None:
            uneven[name] = clock
            say(f"{source.path}: frames are not evenly spaced in time; they are taken at their own stamps")
    return {name: (told | stamped | uneven)[name] for name in entries if name in told or name in stamped or name in uneven}


def _robots_seen(file: Path, recording: Recording) -> dict[str, dict[int, RobotDetections]]:
    found: dict[str, dict[int, RobotDetections]] = {}
    for (frame, camera), seen in read_robot_detections(file, recording.setup(), range(1, recording.frames + 1)).items():
        found.setdefault(camera, {})[frame - 1] = seen
    return found


def _content(file: Path) -> tuple[JsonObject, dict[str, Any]]:
    """The fields of recording.json, and the entries of its cameras."""
    content = JsonObject(read_json(file), str(file))
    if unknown := sorted(set(content.values) - set(KEYS)):
        raise ValueError(f"{file}: field {unknown[0]!r} is unknown, needs one of {', '.join(KEYS)}")
    if content.values.get("format", FORMAT) != FORMAT:
        raise content.refused("format", repr(FORMAT))
    cameras = content.values.get("cameras")
    if not isinstance(cameras, dict) or not 0 < len(cameras) <= MAX_CAMERAS:
        raise ValueError(f"{file}: cameras is missing or empty, needs an object with an entry for each camera, at most {MAX_CAMERAS}")
    for name in cameras:
        if not re.fullmatch(CAMERA_NAME, name):
            raise ValueError(f"{file}: camera {name[:40]!r} needs a name without blanks and any of / \\ , = :")
    return content, cameras


def _searched(given: Any, cameras: Mapping[str, RecordingCamera], where: str) -> dict[str, frozenset[int]]:
    """Fixed camera → frames from 0 that were searched. given: as in recording.json, or None."""
    fixed = [name for name, camera in cameras.items() if camera.robot is None]
    by_camera = dict.fromkeys(fixed, given) if isinstance(given, list) else given
    if given is None:
        return {}
    if not isinstance(by_camera, dict) or (unknown := sorted(set(by_camera) - set(fixed))):
        other = f"names {unknown[0]!r}" if isinstance(by_camera, dict) else f"is {repr(given)[:60]}"
        raise ValueError(f"{where} {other}, needs a list of [first, last] frames from 1, or an object with one for each of {', '.join(fixed)}")
    out: dict[str, frozenset[int]] = {}
    for name, runs in by_camera.items():
        frames: set[int] = set()
        for run in runs if isinstance(runs, list) else [runs]:
            whole = isinstance(run, list) and len(run) in (2, 3) and all(isinstance(one, int) and one > 0 for one in run)
            if not whole or run[0] > run[1] or run[1] > MAX_FRAMES:
                raise ValueError(f"{where} of {name} has {repr(run)[:60]}, needs [first, last] or [first, last, step], frames from 1 to {MAX_FRAMES}")
            frames |= set(range(run[0] - 1, run[1], run[2] if len(run) == 3 else 1))
        out[name] = frozenset(frames)
    return out


def runs_of(frames: Iterable[int]) -> list[list[int]]:
    """Frames from 0 as runs [first, last] from 1."""
    known = set(map(int, frames))
    starts, ends = (sorted(frame for frame in known if frame + step not in known) for step in (-1, 1))
    return [[a + 1, b + 1] for a, b in zip(starts, ends, strict=True)]


def pillars_from(content: JsonObject) -> Array:
    """The field `pillars` (p, 5), as in Setup; none without it. Raises ValueError for other content."""
    pillars = content.array("pillars", (-1, 5), meaning=PILLAR) if "pillars" in content.values else np.zeros((0, 5))
    if not ((pillars[:, 2] > 0) & (pillars[:, 3] < pillars[:, 4])).all():
        raise content.refused("pillars", PILLAR)
    return pillars


def _ground(path: Path, content: JsonObject) -> tuple[Ground, Ground | None]:
    ground = content.values.get("ground", 0.0)
    if isinstance(ground, str):
        return read_terrain(path / content.text("ground", r"[^/\\]+\.npz", "a height in metres or the name of a terrain file (.npz) in the folder"))
    return Flat(content.number("ground", -1e6, 1e6, "metres") if "ground" in content.values else 0.0), None


def _detections(path: Path, cameras: Mapping[str, RecordingCamera]) -> dict[str, FrameBoxes]:
    """The boxes of all cameras that have a file. Raises ValueError for a file of no camera, and for a camera's file with another suffix."""
    folder, found = path / "detections", dict[str, FrameBoxes]()
    if folder.exists() and not folder.is_dir():
        raise ValueError(f"{folder}: is a file, needs to be a folder with CAMERA.txt")
    files = sorted(file for file in folder.glob("*") if not file.name.startswith("."))
    say_left_out(folder, [file for file in files if file.suffix not in (".txt", ".npy") and file.stem not in cameras], "need the name CAMERA.txt")
    for file in files:
        if file.name.endswith(VISIBLE_FILE) and file.name.removesuffix(VISIBLE_FILE) in cameras:
            continue
        if file.suffix == ".txt" and file.stem not in cameras:
            raise ValueError(f"{file}: is of camera {file.stem!r}, {FILE} has {', '.join(cameras)}")
        if file.suffix not in (".txt", ".npy") and file.stem in cameras:
            raise ValueError(f"{file}: is of camera {file.stem!r}, needs the name {file.stem}.txt, or {file.stem}.npy for appearance vectors")
        if file.suffix == ".txt":
            found[file.stem] = read_boxes(file)
    return found


def read_boxes(file: Path) -> dict[int, tuple[Array, Array]]:
    """Detections of a camera (MOT15) → frame from 0 → boxes (n, 4) px and confidence (n,). Raises ValueError with file and line."""
    return {frame - 1: of_frame for frame, of_frame in read_detections(file).items()}


def read_visible_parts(file: Path) -> dict[int, Array]:
    """The visible parts of the boxes of CAMERA.txt, in CAMERA.visible.txt beside it: frame from 0 → (n, 5), as in Recording. Empty without it.

    Raises ValueError with the file for rows that are not those of the boxes, and for shares out of bounds.
    """
    beside = file.with_name(file.stem + VISIBLE_FILE)
    if not beside.is_file():
        return {}
    if not file.is_file():
        raise ValueError(f"{beside}: has no {file.name} beside it, needs the boxes that it belongs to")
    boxes, parts = read_boxes(file), read_boxes(beside)
    for frame in sorted(boxes.keys() | parts.keys()):
        wanted, rows = (len(of[frame][0]) if frame in of else 0 for of in (boxes, parts))
        if wanted != rows:
            raise ValueError(f"{beside}: frame {frame + 1} has {rows} rows, needs {wanted}, one for each of {file.name}")
        if not ((parts[frame][1] >= 0) & (parts[frame][1] <= 1)).all():
            raise ValueError(f"{beside}: frame {frame + 1} has a share that is not in [0, 1]")
    return {frame: np.column_stack(of_frame) for frame, of_frame in parts.items()}


def _of_boxes(folder: Path, cameras: list[str], ending: str) -> dict[str, FrameVectors]:
    """The vectors of all cameras that have some, where `folder` holds CAMERA.txt and CAMERA with the ending.

    Raises ValueError for an array of another shape or type, and for numbers that are not finite.
    """
    return {name: _vectors(folder / (name + ending), folder / f"{name}.txt") for name in cameras if (folder / (name + ending)).is_file()}


def _vectors(file: Path, text: Path) -> dict[int, Array]:
    if not text.is_file():
        raise ValueError(f"{file}: has no {text.name} beside it, needs the boxes that its vectors belong to")
    rows = read_mot15(text)
    try:
        with file.open("rb") as stream:
            vectors = np.lib.format.read_array(stream, allow_pickle=False, max_header_size=10_000)
    except (ValueError, EOFError, MemoryError, OverflowError, SyntaxError, TypeError) as error:
        raise ValueError(f"{file}: is not an array of NumPy ({str(error).splitlines()[0][:100]})") from None
    if vectors.ndim != 2 or vectors.dtype.kind != "f" or not 1 <= vectors.shape[1] <= LONGEST_VECTOR:
        shape = f"has shape {vectors.shape} of {vectors.dtype}"
        raise ValueError(f"{file}: {shape}, needs (rows, d) of floating-point numbers, d from 1 to {LONGEST_VECTOR}")
    if len(vectors) != len(rows):
        raise ValueError(f"{file}: has {len(vectors)} rows, needs {len(rows)}, one for each different row of {text.name}")
    finite: Mask = np.isfinite(vectors).all(axis=1)
    if not finite.all():
        raise ValueError(f"{file}: row {int(np.argmin(finite))} from 0 has a number that is not finite")
    vectors = vectors.astype(np.float64)
    return {frame - 1: vectors[k] for frame, k in rows.by_frame().items()}


def _with_truth(path: Path, recording: Recording, strict: bool) -> Recording:
    """The recording with truth.txt, where there is one. Frames without a row have no people."""
    file = path / "truth.txt"
    if not file.exists():
        return recording
    rows = read_mot15(file, tracks=True)
    if not rows.has_position.all():
        where = place_of_row(file, int(np.argmin(rows.has_position)))
        raise ValueError(f"{where}: has no x, y, z, needs the place on the ground in metres")
    if strict and not any(camera.unknown for camera in recording.cameras.values()):
        _check_truth(file, rows, recording)
    last = int(rows.frame.max()) if len(rows) else 0
    if last > MAX_FRAMES:
        raise ValueError(f"{place_of_row(file, int(np.argmax(rows.frame)))}: frame is {last}, needs at most {MAX_FRAMES}")
    truth: dict[int, tuple[Ints, Array]] = {frame: (np.zeros(0, dtype=np.int64), np.zeros((0, 3))) for frame in range(max(last, recording.frames))}
    for frame, of_frame in rows.by_frame().items():
        truth[frame - 1] = rows.id[of_frame], rows.position[of_frame]
    visible = {frame - 1: np.clip(rows.confidence[of_frame], 0.0, 1.0) for frame, of_frame in rows.by_frame().items()}
    return replace(recording, truth=truth, visible=visible, frames=max(last, recording.frames))


def _check_truth(file: Path, rows: Mot15Rows, recording: Recording) -> None:
    """Raises ValueError for true people outside the area, and in frames that no camera has."""
    setup = recording.setup()
    beyond = setup.distance_beyond(rows.position)
    if (beyond > OUTSIDE).any():
        k = int(np.argmax(beyond > OUTSIDE))
        x, y = rows.position[k, :2]
        raise ValueError(
            f"{file}: frame {rows.frame[k]}, id {rows.id[k]}: x, y are ({x:g}, {y:g}) m, {beyond[k]:.3g} m outside the area of {FILE},"
            f" needs at most {OUTSIDE:g} m ({int((beyond > OUTSIDE).sum())} rows); `pilsim check` tells whether a unit is wrong"
        )
    late = rows.frame > recording.frames
    if recording.frames and late.any():
        k = int(np.argmax(late))
        raise ValueError(
            f"{file}: frame is {rows.frame[k]}, which no camera has, needs at most {recording.frames}, the last frame with detections or images"
            f" (or frames in {FILE}); `pilsim check` tells whether frames are numbered otherwise"
        )


def _robots(path: Path) -> dict[str, RecordingRobot]:
    file = path / "robots.json"
    if not file.is_file():
        return {}
    content = JsonObject(read_json(file), str(file))
    starts = {name: _start(content.part(name)) for name in content.values}
    if starts and not any(starts.values()):
        raise ValueError(f"{file}: start is null of each robot, needs one with a start, which defines the world frame")
    known = {"robot": starts}
    odometry, truth = rows_by_frame(path / "odometry.csv", ODOMETRY, ("robot",), known), None
    if (path / ROBOT_TRUTH).is_file():
        truth = rows_by_frame(path / ROBOT_TRUTH, {"frame": int, "robot": str, **dict.fromkeys(POSE, float)}, ("robot",), known)
    for name, rows in (("odometry.csv", odometry), (ROBOT_TRUTH, truth or {})):
        if rows and not (min(rows) >= 1 and max(rows) <= MAX_FRAMES):
            raise ValueError(f"{path / name}: frames are {min(rows)} to {max(rows)}, needs 1 to {MAX_FRAMES}")
    return {
        name: RecordingRobot(
            start,
            {
                frame - 1: odometry_from(row, f"{path / 'odometry.csv'}: frame {frame}")
                for frame, rows in odometry.items()
                for row in rows
                if row["robot"] == name
            },
            None
            if truth is None
            else {f - 1: pose_from([row[c] for c in POSE]) for f, rows in truth.items() for row in rows if row["robot"] == name},
        )
        for name, start in starts.items()
    }


def _start(entry: JsonObject) -> Start | None:
    """{"start": null or {"position": [x, y, z], "quaternion": [w, x, y, z], "covariance": (6, 6), optional}}."""
    if entry.values.get("start", 0) is None:
        return None
    start, covariance = entry.part("start"), START_SIGMA**2 * np.eye(6)
    pose = [*start.array("position", (3,), meaning="x, y, z m").tolist(), *start.array("quaternion", (4,), meaning="w, x, y, z").tolist()]
    if "covariance" in start.values and not (covariance := start.array("covariance", (6, 6))).any():
        raise start.refused("covariance", "more than zeros: the robot moves")
    try:
        return Start(pose_from(pose), covariance)
    except ValueError as error:
        raise ValueError(f"{start.where}: {error}") from None


def _checksums(path: Path) -> dict[str, str]:
    beside = ("truth.txt", "robots.json", "odometry.csv", ROBOT_TRUTH, ROBOTS_SEEN, TIMES)
    files = [path / FILE, *sorted(path.glob("detections/[!.]*.txt")), *sorted(path.glob("detections/[!.]*.npy")), *(path / name for name in beside)]
    return checksums(path, files)


def write_recording(folder: Path, recording: Recording) -> None:
    """Write a recording into an existing empty folder; read_recording reads the same. Images and videos are copied.

    Of equal boxes in a frame only the first is written, because readers merge equal rows.
    Raises ValueError for terrain that is neither flat nor a height map, and for a camera model that the format cannot hold.
    """
    recording = _without_repeated_boxes(recording)
    content: dict[str, Any] = {"format": FORMAT, "rate": recording.rate, "frames": recording.frames}
    if recording.area is not None:
        content["area"] = np.asarray(recording.area).tolist()
    if recording.searched:
        content["searched"] = {name: runs_of(frames) for name, frames in recording.searched.items()}
    content["ground"] = _write_ground(folder, recording)
    content["height"] = list(recording.height)
    if len(recording.pillars):
        content["pillars"] = np.asarray(recording.pillars).tolist()
    content["cameras"] = {name: camera_to(camera) | clock_fields(recording.clocks.get(name)) for name, camera in recording.cameras.items()}
    write_json(folder / FILE, content, indent=1)
    (folder / "detections").mkdir()
    for name, boxes in recording.detections.items():
        write_mot15(folder / "detections" / f"{name}.txt", rows_from_boxes({frame + 1: of_frame for frame, of_frame in boxes.items()}))
    _write_of_boxes(folder / "detections", ".npy", recording.detections, recording.appearances)
    _write_of_boxes(folder / "detections", COVARIANCES, recording.detections, recording.covariances)
    for name, parts in recording.visible_parts.items():
        whole = {f: parts.get(f, np.column_stack([box, np.ones(len(box))])) for f, (box, _) in recording.detections[name].items()}
        rows_of = rows_from_boxes({f + 1: (of_frame[:, :4], of_frame[:, 4]) for f, of_frame in whole.items()})
        write_mot15(folder / "detections" / (name + VISIBLE_FILE), rows_of)
    if recording.robot_detections:
        seen_by = ((frame, name, seen) for name, of_camera in recording.robot_detections.items() for frame, seen in of_camera.items())
        rows_seen = [row for frame, name, seen in sorted(seen_by, key=lambda s: s[:2]) for row in robot_detection_rows(frame + 1, name, seen)]
        write_table(folder / ROBOTS_SEEN, list(ROBOT_DETECTIONS), rows_seen)
    if recording.truth is not None:
        rows = rows_from_tracks({frame + 1: people for frame, people in recording.truth.items()})
        seen = [recording.visible.get(frame, np.ones(len(ids))) for frame, (ids, _) in sorted(recording.truth.items())]
        write_mot15(folder / "truth.txt", replace(rows, confidence=np.concatenate([np.zeros(0), *seen])))
    if recording.robots:
        _write_robots(folder, recording)
    if any(clock.stamps is not None for clock in recording.clocks.values()):
        write_times(folder / TIMES, recording.clocks)
    for name in recording.images:
        _copy_images(folder, name, recording)


def _without_repeated_boxes(recording: Recording) -> Recording:
    """The recording with each box of a frame once, and with the vectors of the kept boxes."""
    first: dict[str, dict[int, Ints]] = {name: {} for name in recording.detections}
    for name, boxes in recording.detections.items():
        for frame, (box, confidence) in boxes.items():
            rows = different_rows(np.column_stack([box, confidence]))
            if len(rows) < len(box):
                first[name][frame] = rows
    if not any(first.values()):
        return recording

    def left(name: str, of: Mapping[int, Any]) -> dict[int, Any]:
        rows = first.get(name, {})
        return {f: tuple(part[rows[f]] for part in one) if isinstance(one, tuple) else one[rows[f]] for f, one in of.items() if f in rows}

    changed: dict[str, Any] = {
        kind: {name: {**of, **left(name, of)} for name, of in getattr(recording, kind).items()} for kind in ("detections", *OF_BOXES)
    }
    return replace(recording, **changed)


def _write_of_boxes(folder: Path, ending: str, detections: Mapping[str, FrameBoxes], of_cameras: Mapping[str, FrameVectors]) -> None:
    """Write a file of each camera with vectors, in the order of its boxes; zeros where a frame has boxes and no vectors."""
    for name, vectors in of_cameras.items():
        length = max((of_frame.shape[1] for of_frame in vectors.values()), default=0)
        if not length:
            continue
        parts = [vectors.get(frame, np.zeros((len(boxes), length))) for frame, (boxes, _) in detections[name].items()]
        with new_file(folder / (name + ending)) as part, part.open("wb") as out:
            np.save(out, np.concatenate(parts).astype(np.float64 if ending == COVARIANCES else np.float32))


def _write_ground(folder: Path, recording: Recording) -> float | str:
    ground, tops = recording.ground, recording.occluders
    if isinstance(ground, Flat) and tops is None:
        return ground.level
    heights = getattr(ground, "heights", None)
    if heights is None:
        raise ValueError(f"ground is a {type(ground).__name__}, needs flat ground or a height map")
    with (folder / "terrain.npz").open("wb") as file:
        np.savez_compressed(file, heights=heights, origin=ground.origin, spacing=ground.spacing, tops=heights if tops is None else tops.heights)  # type: ignore[attr-defined]
    return "terrain.npz"


def _write_robots(folder: Path, recording: Recording) -> None:
    entries: dict[str, Any] = {}
    for name, robot in recording.robots.items():
        if robot.start is None:
            entries[name] = {"start": None}
            continue
        row = pose_row(robot.start.T_world_robot)
        entries[name] = {"start": {"position": row[:3], "quaternion": row[3:], "covariance": robot.start.covariance.tolist()}}
    write_json(folder / "robots.json", entries, indent=1)
    motions = [(f, name, odometry) for name, robot in recording.robots.items() for f, odometry in robot.odometry.items()]
    write_table(
        folder / "odometry.csv", list(ODOMETRY), [odometry_row(f + 1, name, odometry) for f, name, odometry in sorted(motions, key=lambda m: m[:2])]
    )
    poses: list[tuple[int, str, Pose]] = [
        (f, name, pose) for name, robot in recording.robots.items() if robot.truth is not None for f, pose in robot.truth.items()
    ]
    if poses:
        rows = [[f + 1, name, *pose_row(pose)] for f, name, pose in sorted(poses, key=lambda p: p[:2])]
        write_table(folder / ROBOT_TRUTH, ["frame", "robot", *POSE], rows)


def _copy_images(folder: Path, name: str, recording: Recording) -> None:
    """Copy the images of a camera. Those from the middle of a video are written as JPEG files, because a video can be cut only at key frames."""
    source = recording.images[name]
    if isinstance(source, VideoFile) and source.first == 0:
        (folder / "video").mkdir(exist_ok=True)
        shutil.copyfile(source.path, folder / "video" / f"{name}{source.path.suffix}")
        return
    own = folder / "images" / name
    own.mkdir(parents=True)
    if isinstance(source, ImageFiles):
        for frame, path in source.files.items():
            shutil.copyfile(path, own / f"{frame + 1:06d}{path.suffix}")
        return
    camera, ticks = recording.cameras[name].camera, recording.schedule.ticks()
    count = max((tick.frames[name] + 1 for tick in ticks if name in tick.frames), default=0)
    if isinstance(source, VideoFile):
        count = min(count, source.frames())
    for frame, image in enumerate(source.images(count, (camera.height, camera.width))):
        if image is not None:
            file = f"{frame + 1:06d}.jpg"
            (own / file).write_bytes(encoded(file, image[:, :, ::-1], [cv2.IMWRITE_JPEG_QUALITY, QUALITY]))
