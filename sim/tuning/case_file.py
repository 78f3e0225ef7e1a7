"""A case of the population and its file: an npz of whole numbers with a JSON header, the same bytes for the same case."""

from __future__ import annotations

import itertools
import json
import zipfile
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tracker.geometry import Array, Pose
from tracker.geometry.ground import Flat, Grid
from tracker.geometry.poses import quaternion_from_rotation, rotation_from_quaternion
from tracker.io.atomic import new_file
from tracker.io.json_files import json_text
from tracker.recordings import Recording
from tracker.recordings.camera_json import camera_from, camera_to
from tracker.recordings.recording import RecordingRobot
from tracker.types import Odometry, Start

VERSION = 5
"""Version of the population; cases of other versions are refused."""
PIXEL, METRE, SHARE = 100, 1000, 10000
"""Steps per px, m and 1 to which boxes, positions, and confidences and visible shares are rounded."""
TINY_VARIANCE = 1e-10
"""m², rad²: variance of the poses of rovers, which are true."""


@dataclass(frozen=True, eq=False)
class PopulationCase:
    """A case: its number and seed, its kind (kinds.BLOCK), the recording with exact truth, and the delay of estimates, frames."""

    number: int
    seed: int
    kind: str
    recording: Recording
    delay: int

    @property
    def name(self) -> str:
        return f"{self.kind} {self.number}"


def case_path(folder: Path, number: int, seed: int, key: str = "") -> Path:
    """The file of a case in a folder of cases. key: of the user's cameras, "" for the population."""
    return folder / f"case-{seed}-{number:05d}{key and '-'}{key}.npz"


def write_case(path: Path, case: PopulationCase) -> None:
    """Write a case atomically. Raises OSError where the file cannot be written."""
    recording = case.recording
    names = list(recording.cameras)
    boxes = [(names.index(name), frame, *found) for name, of in recording.detections.items() for frame, found in sorted(of.items())]
    truth = recording.truth or {}
    people = [(frame, *truth[frame], recording.visible[frame]) for frame in sorted(truth)]
    header = {
        "version": VERSION,
        "number": case.number,
        "seed": case.seed,
        "kind": case.kind,
        "delay": case.delay,
        "rate": recording.rate,
        "frames": recording.frames,
        "cameras": {name: camera_to(camera) for name, camera in recording.cameras.items()},
        "robots": list(recording.robots),
    }
    arrays: dict[str, Array | np.ndarray[Any, Any]] = {
        "box_at": np.repeat(np.array([row[:2] for row in boxes], dtype=np.int32).reshape(-1, 2), [len(row[2]) for row in boxes], axis=0),
        "box": _whole(np.concatenate([row[2] for row in boxes]), PIXEL),
        "confidence": _whole(np.concatenate([row[3] for row in boxes]), SHARE),
        "person_at": np.array([(frame, one) for frame, ids, _, _ in people for one in ids.tolist()], dtype=np.int32).reshape(-1, 2),
        "feet": _whole(np.concatenate([row[2] for row in people]), METRE),
        "visible": _whole(np.concatenate([row[3] for row in people]), SHARE),
        "area": np.asarray(recording.area),
        "pillars": recording.pillars,
    }
    for name, grid in (("ground", recording.ground), ("occluders", recording.occluders)):
        if isinstance(grid, Grid):
            arrays |= {name: _whole(grid.heights, METRE), f"{name}_grid": np.array([*grid.origin, grid.spacing])}
    for name, robot in recording.robots.items():
        poses = [(robot.truth or {})[frame] for frame in range(recording.frames)]
        arrays[f"robot_{name}"] = rows_of(poses)
    with new_file(path) as partial, partial.open("wb") as file:
        np.savez_compressed(file, header=np.frombuffer(json_text(header).encode(), dtype=np.uint8), **arrays)  # type: ignore[arg-type]


def read_case(path: Path) -> PopulationCase:
    """Read a case. Raises ValueError, in one line with the path, for a file of another version or other content."""
    try:
        with np.load(path) as file:
            arrays = dict(file)
        header = json.loads(arrays["header"].tobytes())
        version = header["version"]
    except (OSError, ValueError, KeyError, zipfile.BadZipFile, zlib.error):
        raise ValueError(f"{path}: is no case of a population; remove it") from None
    if version != VERSION:
        raise ValueError(f"{path}: is of version {version} of the population, needs {VERSION}; choose another folder or remove it")
    cameras = {name: camera_from(entry, f"{path}: cameras.{name}") for name, entry in header["cameras"].items()}
    at, box, confidence = arrays["box_at"], arrays["box"] / PIXEL, arrays["confidence"] / SHARE
    rows = _groups(at[:, 0].astype(np.int64) * header["frames"] + at[:, 1], len(cameras) * header["frames"])
    found = {
        name: {frame: (box[rows[k * header["frames"] + frame]], confidence[rows[k * header["frames"] + frame]]) for frame in range(header["frames"])}
        for k, name in enumerate(cameras)
    }
    people = _groups(arrays["person_at"][:, 0], header["frames"])
    ids, feet, visible = arrays["person_at"][:, 1].astype(np.int64), arrays["feet"] / METRE, arrays["visible"] / SHARE
    recording = Recording(
        header["rate"],
        cameras,
        found,
        {frame: (ids[of], feet[of]) for frame, of in enumerate(people)},
        frames=header["frames"],
        area=arrays["area"],
        ground=_grid(arrays, "ground") or Flat(),
        occluders=_grid(arrays, "occluders"),
        pillars=arrays["pillars"],
        robots={name: true_robot(arrays[f"robot_{name}"]) for name in header["robots"]},
        visible={frame: visible[of] for frame, of in enumerate(people)},
        source={"source": "population", "number": header["number"], "seed": header["seed"]},
    )
    return PopulationCase(header["number"], header["seed"], header["kind"], recording, header["delay"])


def rows_of(poses: list[Pose]) -> Array:
    """Position m and quaternion (n, 7) of poses."""
    return np.array([[*pose.translation, *quaternion_from_rotation(pose.rotation)] for pose in poses])


def true_robot(rows: Array) -> RecordingRobot:
    """A rover whose odometry is its true motion; rows (frames, 7): position m and quaternion of its pose in each frame."""
    poses = [Pose(rotation_from_quaternion(row[3:]), row[:3]) for row in rows]
    P = TINY_VARIANCE / 100 * np.eye(6)
    odometry = {k: Odometry(before.inverse() @ now, P) for k, (before, now) in enumerate(itertools.pairwise(poses), 1)}
    return RecordingRobot(Start(poses[0], TINY_VARIANCE * np.eye(6)), odometry, dict(enumerate(poses)))


def _whole(values: Array, steps: int) -> np.ndarray[Any, Any]:
    return np.rint(np.asarray(values) * steps).astype(np.int32)


def _groups(key: np.ndarray[Any, Any], count: int) -> list[np.ndarray[Any, Any]]:
    """Rows of each key from 0 to count − 1, of rows that are sorted by their keys."""
    ends = np.searchsorted(key, np.arange(count + 1))
    return [np.arange(low, high) for low, high in itertools.pairwise(ends.tolist())]


def _grid(arrays: dict[str, Any], name: str) -> Grid | None:
    if name not in arrays:
        return None
    *origin, spacing = arrays[f"{name}_grid"].tolist()
    return Grid(arrays[name] / METRE, np.array(origin), spacing)
