"""Reading a sequence from the folder that `writer.py` wrote.

README.md in that folder (schema.README) describes each file and column. `truth_tables.py` reads the ground truth of single views.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Container, Iterator
from pathlib import Path
from typing import Any, TypeVar

import cv2
import numpy as np

from tracker.geometry import Array, Image, Pose
from tracker.geometry.ground import Flat, Ground
from tracker.io.csv_tables import read_terrain, rows_by_frame
from tracker.io.image_files import decode_image
from tracker.io.json_files import read_json
from tracker.io.resume import checksum
from tracker.sequence.calibration import pose_from, setup_from
from tracker.sequence.manifest import check_file, read_manifest
from tracker.sequence.schema import DETECTIONS, LAYERS, ODOMETRY, POSE, ROBOT_DETECTIONS, ROBOTS, SITS, UPPER_TRIANGLE
from tracker.sequence.truth_tables import people_columns_of
from tracker.types import Detections, Mount, Odometry, RobotDetections, Sequence, Setup, Tick, Truth, View

T = TypeVar("T")


def read_sequence(folder: Path) -> Sequence:
    """Open a folder written by SequenceWriter. Images are read tick by tick, and each is checked against the manifest.

    Raises ValueError with file and line or field for missing or damaged content, and for an unreadable schema version.
    """
    files = read_manifest(folder)["files"]
    for name, entry in files.items():
        # Each of the many images is checked only when it is read.
        check_file(folder, name, entry, sums=Path(name).parts[0] not in LAYERS)
    return read_contents(folder, files)


def read_contents(folder: Path, files: dict[str, Any]) -> Sequence:
    """As read_sequence, without a check of the files. files: those of the manifest."""
    setup = _read_setup(folder, *read_terrain(folder / "terrain.npz"))
    truth = _read_truth(folder, setup)
    ticks = _DiskTicks(folder, setup, len(truth), files)
    provenance = {"scenario": read_json(folder / "scenario.json"), "manifest": checksum(folder / "manifest.json")}
    return Sequence(setup, ticks, truth, provenance)


def read_flat_setup(folder: Path) -> Setup:
    """The setup of a sequence on flat ground: its terrain is not read. Raises ValueError with the path for invalid content."""
    return _read_setup(folder, Flat(), None)


def _read_setup(folder: Path, ground: Ground, occluders: Ground | None) -> Setup:
    path = folder / "calibration.json"
    calibration = read_json(path)
    try:
        return setup_from(calibration, ground, occluders)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None
    except (KeyError, TypeError, AttributeError) as error:
        raise ValueError(f"{path}: field {error} is missing or of the wrong kind") from None


def _read_truth(folder: Path, setup: Setup) -> tuple[Truth, ...]:
    path = folder / "truth" / "robots.csv"
    robots = rows_by_frame(path, ROBOTS, ("robot",), {"robot": setup.starts, "tipped": (0, 1)})
    if sorted(robots) != list(range(len(robots))):
        raise ValueError(f"{folder / 'truth' / 'robots.csv'}: frames are not 0 to {len(robots) - 1} without gaps")
    for k, rows in robots.items():
        if len(rows) != len(setup.starts):
            raise ValueError(f"{folder / 'truth' / 'robots.csv'}: frame {k} has {len(rows)} robots, needs {len(setup.starts)}")
    known: dict[str, Container[Any]] = {"frame": range(len(robots))}
    columns = people_columns_of(folder, setup.mounts)
    sits = SITS in columns
    people = rows_by_frame(folder / "truth" / "people.csv", columns, ("person",), known | ({SITS: (0, 1)} if sits else {}))
    visible = [f"visible_{camera}" for camera in setup.mounts]
    return tuple(
        Truth(
            k,
            {row["robot"]: _pose(row, f"{path}: frame {k}, {row['robot']}") for row in robots[k]},
            np.array([row["person"] for row in people.get(k, [])], dtype=np.int64),
            np.array([[row["x"], row["y"], row["z"]] for row in people.get(k, [])]).reshape(-1, 3),
            np.array([[row[c] for c in visible] for row in people.get(k, [])]).reshape(-1, len(visible)),
            tipped=frozenset(row["robot"] for row in robots[k] if row["tipped"]),
            sitting=frozenset(row["person"] for row in people.get(k, []) if row[SITS]) if sits else None,
        )
        for k in range(len(robots))
    )


def _pose(row: dict[str, Any], where: str) -> Pose:
    try:
        return pose_from([row[c] for c in POSE])
    except ValueError as error:
        raise ValueError(f"{where}: {error}") from None


class _DiskTicks:
    """Ticks of a folder; images are read during iteration."""

    def __init__(self, folder: Path, setup: Setup, count: int, files: dict[str, Any]) -> None:
        self.folder, self.setup, self.count, self.files = folder, setup, count, files
        frames = range(count)
        self._odometry = rows_by_frame(folder / "odometry.csv", ODOMETRY, ("robot",), {"frame": frames, "robot": setup.starts})
        self._detections = read_detections(folder / "detections.csv", setup, frames)
        self._robot_detections = read_robot_detections(folder / "companions.csv", setup, frames) if "companions.csv" in files else None

    def __len__(self) -> int:
        return self.count

    def odometry(self) -> Iterator[dict[str, Odometry]]:
        for k in range(self.count):
            yield {row["robot"]: odometry_from(row, f"{self.folder / 'odometry.csv'}: frame {k}") for row in self._odometry.get(k, [])}

    def __iter__(self) -> Iterator[Tick]:
        for k, odometry in enumerate(self.odometry()):
            yield Tick(
                k,
                k * self.setup.period,
                tuple(
                    View(
                        name,
                        self._detections.get((k, name), Detections.none()),
                        odometry=odometry.get(mount.robot),
                        image=self._image(f"images/{name}/{k:06d}", mount),
                        robot_detections=None if self._robot_detections is None else self._robot_detections.get((k, name), RobotDetections.none()),
                    )
                    for name, mount in self.setup.mounts.items()
                ),
            )

    def _image(self, stem: str, mount: Mount) -> Image:
        data, path = image_bytes(self.folder, stem, self.files)
        try:
            image = decode_image(data, (mount.camera.height, mount.camera.width), cv2.IMREAD_COLOR)
        except ValueError as error:
            raise ValueError(f"{path}: {error}") from None
        return np.ascontiguousarray(image[:, :, ::-1], dtype=np.uint8)


def image_bytes(folder: Path, stem: str, files: dict[str, Any]) -> tuple[bytes, Path]:
    """The bytes and the path of an image by its name without suffix. files: of the manifest.

    Raises ValueError with the path where the manifest does not name it, and where its SHA-256 differs.
    """
    name = next((stem + ending for ending in (".jpg", ".png") if stem + ending in files), None)
    if name is None:
        raise ValueError(f"{folder / stem}.jpg: the manifest does not name it, nor a .png")
    data = (folder / name).read_bytes()
    if hashlib.sha256(data).hexdigest() != files[name]["sha256"]:
        raise ValueError(f"{folder / name}: its SHA-256 is not the manifest's: truncated or changed")
    return data, folder / name


def read_detections(path: Path, setup: Setup, frames: range) -> dict[tuple[int, str], Detections]:
    """Read a table of boxes: (frame, camera) → detections. Views without detections have no entry. Raises ValueError as read_robot_detections."""

    def detected(_: str, rows: list[dict[str, Any]]) -> Detections:
        extent, confidence = np.array([[r["width"], r["height"]] for r in rows]), np.array([r["confidence"] for r in rows])
        return Detections(_bearings(rows), extent, confidence, _covariances(rows), np.zeros((len(rows), 0)))

    return _by_view(path, rows_by_frame(path, DETECTIONS, (), {"frame": frames, "camera": setup.mounts}), detected)


def read_robot_detections(path: Path, setup: Setup, frames: range) -> dict[tuple[int, str], RobotDetections]:
    """Read a table of other robots that are seen: (frame, camera) → detections. Views without detections have no entry.

    frames: the valid indices. Raises ValueError with the path for invalid rows, robots without a camera, and robots that detect themselves.
    """

    def detected(camera: str, rows: list[dict[str, Any]]) -> RobotDetections:
        found = RobotDetections(_bearings(rows), tuple(row["robot"] for row in rows), _covariances(rows))
        setup.check_robot_detections(camera, found)
        return found

    known = {"frame": frames, "camera": setup.mounts, "robot": setup.starts}
    return _by_view(path, rows_by_frame(path, ROBOT_DETECTIONS, ("camera", "robot"), known), detected)


def _by_view(path: Path, frames: dict[int, list[dict[str, Any]]], detected: Callable[[str, list[dict[str, Any]]], T]) -> dict[tuple[int, str], T]:
    """(frame, camera) → the result of `detected` for its rows."""
    found = dict[tuple[int, str], list[dict[str, Any]]]()
    for k, rows in frames.items():
        for row in rows:
            found.setdefault((k, row["camera"]), []).append(row)
    out = {}
    for (k, camera), rows in found.items():
        try:
            out[k, camera] = detected(camera, rows)
        except ValueError as error:
            raise ValueError(f"{path}: frame {k} of {camera}: {error}") from None
    return out


def odometry_from(row: dict[str, Any], where: str) -> Odometry:
    """The odometry of a row that writer.odometry_row made. Raises ValueError that begins with `where`, the file and the frame."""
    covariance = np.zeros((6, 6))
    for i, j in UPPER_TRIANGLE:
        covariance[i, j] = covariance[j, i] = row[f"c{i}{j}"]
    up = np.array([row["up_x"], row["up_y"], row["up_z"]])
    try:
        return Odometry(pose_from([row[c] for c in POSE]), covariance, up if up.any() else None, float(row["up_sigma"]))
    except ValueError as error:
        raise ValueError(f"{where}, {row['robot']}: {error}") from None


def _bearings(rows: list[dict[str, Any]]) -> Array:
    """Bearings (n, 3), normalized after rounding in the file."""
    bearing = np.array([[r["bearing_x"], r["bearing_y"], r["bearing_z"]] for r in rows])
    length = np.linalg.norm(bearing, axis=1, keepdims=True)
    if not (length > 0).all():
        raise ValueError("a bearing is (0, 0, 0), needs a direction")
    return np.asarray(bearing / length)


def _covariances(rows: list[dict[str, Any]]) -> Array:
    return np.array([[[r["c00"], r["c01"]], [r["c01"], r["c11"]]] for r in rows])
