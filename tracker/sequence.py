"""A Sequence: what the tracker is given, in memory or in a folder. Writer and reader side by side.

The folder's own README.md (written from README below) says what every file and column is.
"""

from __future__ import annotations

import hashlib
import json
import shutil
import zipfile
import zlib
from collections.abc import Container, Iterator
from collections.abc import Sequence as Items
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from tracker.cameras import Panorama
from tracker.geometry import Array, Pose, quaternion_from_rotation, rotation_from_quaternion
from tracker.ground import Grid
from tracker.layout import BOXES, DETECTIONS, NEEDED, ODOMETRY, POSE, README, ROBOTS, SCHEMA, UPPER
from tracker.measurements import Detections, Image, Mount, Odometry, Setup, Start, Tick, Truth, View
from tracker.tables import read_table, write_table


class Ticks(Protocol):
    """Ticks in order, as often as one likes; odometry: robot → motion, a frame, without looking at images."""

    def __len__(self) -> int: ...

    def __iter__(self) -> Iterator[Tick]: ...

    def odometry(self) -> Iterator[dict[str, Odometry]]: ...


@dataclass(frozen=True, eq=False)
class TicksInMemory:
    """Ticks held in a tuple."""

    ticks: tuple[Tick, ...]
    mounts: dict[str, Mount]

    def __len__(self) -> int:
        return len(self.ticks)

    def __iter__(self) -> Iterator[Tick]:
        return iter(self.ticks)

    def odometry(self) -> Iterator[dict[str, Odometry]]:
        for tick in self.ticks:
            yield {self.mounts[v.camera].robot: v.odometry for v in tick.views if v.odometry is not None}


@dataclass(frozen=True, eq=False)
class Sequence:
    """setup, ticks (one a period), truth (one a tick) or None, provenance: what made it, as JSON values."""

    setup: Setup
    ticks: Ticks
    truth: tuple[Truth, ...] | None
    provenance: dict[str, Any]


@dataclass(frozen=True, eq=False)
class Boxes:
    """True boxes of people in one camera: person (n,), seen and full (n, 4) left, top, right, bottom px, visible (n,) fraction."""

    person: Array
    seen: Array
    full: Array
    visible: Array


def _pose_row(pose: Pose) -> list[float]:
    return [*map(float, pose.translation), *map(float, quaternion_from_rotation(pose.rotation))]


def _pose_from(row: Items[float]) -> Pose:
    return Pose(rotation_from_quaternion(row[3:7]), np.array(row[:3]))


class SequenceWriter:
    """Writes a Sequence under a temporary name; only `finish` gives it its own. As a context it cleans up after an error."""

    def __init__(self, folder: Path, setup: Setup, tops: Grid) -> None:
        self.folder, self.setup = folder, setup
        self.partial = folder.with_name(f".{folder.name}.partial")
        self.tops = tops
        self._rows: dict[str, list[list[object]]] = {name: [] for name in ("odometry", "detections", "robots", "people", "boxes")}

    def __enter__(self) -> SequenceWriter:
        if self.partial.exists():
            shutil.rmtree(self.partial)
        (self.partial / "truth").mkdir(parents=True)
        for camera in self.setup.mounts:
            (self.partial / "images" / camera).mkdir(parents=True)
            (self.partial / "instances" / camera).mkdir(parents=True)
        ground = self.setup.ground
        assert isinstance(ground, Grid)
        np.savez(self.partial / "terrain.npz", heights=ground.heights, origin=ground.origin, spacing=ground.spacing, tops=self.tops.heights)
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        if self.partial.exists():
            shutil.rmtree(self.partial)

    def add(self, tick: Tick, truth: Truth, instances: dict[str, NDArray[np.uint16]], boxes: dict[str, Boxes]) -> None:
        """Append one tick; instances: camera → (H, W) uint16."""
        k, rows = tick.index, self._rows
        for view in tick.views:
            robot = self.setup.mounts[view.camera].robot
            if view.odometry is not None:
                o = view.odometry
                up = [*map(float, o.gravity), o.gravity_sigma] if o.gravity is not None else [0.0, 0.0, 0.0, 0.0]
                rows["odometry"].append([k, robot, *_pose_row(o.T_before_now), *up, *(float(o.covariance[i, j]) for i, j in UPPER)])
            d = view.detections
            for b, e, c, s in zip(d.bearing, d.extent, d.confidence, d.covariance, strict=True):
                rows["detections"].append([k, view.camera, *map(float, [*b, *e, c, s[0, 0], s[0, 1], s[1, 1]])])
            assert view.image is not None
            self._image(Path("images", view.camera, f"{k:06d}.jpg"), view.image[:, :, ::-1], [cv2.IMWRITE_JPEG_QUALITY, 95])
            self._image(Path("instances", view.camera, f"{k:06d}.png"), instances[view.camera], [cv2.IMWRITE_PNG_COMPRESSION, 1])
            t = boxes[view.camera]
            for p, seen, full, visible in zip(t.person, t.seen, t.full, t.visible, strict=True):
                rows["boxes"].append([k, view.camera, int(p), *map(float, [*seen, *full, visible])])
        rows["robots"] += [[k, robot, *_pose_row(pose)] for robot, pose in truth.T_world_robot.items()]
        for person, feet, fractions in zip(truth.person_id, truth.feet, truth.visible, strict=True):
            rows["people"].append([k, int(person), *map(float, feet), *map(float, fractions)])

    def _image(self, name: Path, image: Any, options: list[int]) -> None:
        ok, data = cv2.imencode(name.suffix, image, options)
        if not ok:
            raise ValueError(f"{name}: this image cannot be written as {name.suffix}")
        (self.partial / name).write_bytes(data.tobytes())

    def finish(self, provenance: dict[str, Any], versions: dict[str, str]) -> None:
        """Write tables, calibration and manifest, and give the folder its name."""
        rows, root = self._rows, self.partial
        write_table(root / "odometry.csv", list(ODOMETRY), rows["odometry"])
        write_table(root / "detections.csv", list(DETECTIONS), rows["detections"])
        write_table(root / "truth" / "robots.csv", list(ROBOTS), rows["robots"])
        write_table(root / "truth" / "people.csv", list(_people_columns(self.setup)), rows["people"])
        write_table(root / "truth" / "boxes.csv", list(BOXES), rows["boxes"])
        (root / "README.md").write_text(README, encoding="utf-8")
        _write_json(root / "scenario.json", provenance)
        _write_json(root / "calibration.json", _calibration(self.setup))
        files = {
            path.relative_to(root).as_posix(): {"sha256": _sha256(path.read_bytes()), "bytes": path.stat().st_size}
            for path in sorted(root.rglob("*"))
            if path.is_file()
        }
        _write_json(root / "manifest.json", {"schema": SCHEMA, "versions": versions, "files": files})
        root.rename(self.folder)


def _write_json(path: Path, value: object) -> None:
    path.write_text(json.dumps(value, indent=1, allow_nan=False) + "\n", encoding="utf-8")


def _people_columns(setup: Setup) -> dict[str, type]:
    return {"frame": int, "person": int, "x": float, "y": float, "z": float} | {f"visible_{camera}": float for camera in setup.mounts}


def _calibration(setup: Setup) -> dict[str, Any]:
    return {
        "period": setup.period,
        "height": list(setup.height),
        "cameras": {
            name: {
                "model": "panorama",
                "width": mount.camera.width,
                "height": mount.camera.height,
                "robot": mount.robot,
                "T_body_camera": _pose_row(mount.T_body_camera),
            }
            for name, mount in setup.mounts.items()
        },
        "starts": {
            name: {"T_world_robot": _pose_row(start.T_world_robot), "covariance": start.covariance.tolist()} if start else None
            for name, start in setup.starts.items()
        },
    }


def read_json(path: Path) -> Any:
    """JSON of a file; ValueError with path and line where it is none."""
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise ValueError(f"{path}: no such file") from None
    except json.JSONDecodeError as error:
        raise ValueError(f"{path}:{error.lineno}: not JSON ({error.msg})") from None
    except UnicodeDecodeError:
        raise ValueError(f"{path}: not a text file") from None
    except RecursionError:
        raise ValueError(f"{path}: nested too deep") from None


def _read_manifest(folder: Path) -> dict[str, dict[str, Any]]:
    """File name → its SHA-256 and size, checked: the files are there, of that size, and all but the images of that sum."""
    path = folder / "manifest.json"
    manifest = read_json(path)
    schema = manifest.get("schema") if isinstance(manifest, dict) else None
    if schema != SCHEMA or not isinstance(manifest.get("files"), dict):
        raise ValueError(f"{path}: schema is {schema}, this version reads {SCHEMA}")
    for name, entry in manifest["files"].items():
        if not isinstance(entry, dict) or not isinstance(entry.get("bytes"), int) or not isinstance(entry.get("sha256"), str):
            raise ValueError(f"{path}: entry {name[:80]!r} has no sha256 and bytes")
        if Path(name).is_absolute() or ".." in Path(name).parts:
            raise ValueError(f"{path}: entry {name[:80]!r} lies outside the folder")
        file = folder / name
        if not file.is_file():
            raise ValueError(f"{file}: missing, though the manifest names it")
        if file.stat().st_size != entry["bytes"]:
            raise ValueError(f"{file}: {file.stat().st_size} bytes, the manifest says {entry['bytes']}: truncated or changed")
        # Images are many: each is checked when it is read.
        if Path(name).parts[0] not in ("images", "instances") and _sha256(file.read_bytes()) != entry["sha256"]:
            raise ValueError(f"{file}: its SHA-256 is not the manifest's: changed")
    missing = [name for name in NEEDED if name not in manifest["files"]]
    if missing:
        raise ValueError(f"{path}: does not name {missing[0]}")
    return dict(manifest["files"])


def _sha256(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


def read_sequence(folder: Path) -> Sequence:
    """Open a folder written by SequenceWriter. Images are read tick by tick, and each is checked against the manifest.

    Raises ValueError that names the file, and the line or field, of what is missing, damaged or of another schema version.
    """
    files = _read_manifest(folder)
    try:
        setup = _read_setup(folder)
    except (KeyError, TypeError, AttributeError) as error:
        raise ValueError(f"{folder / 'calibration.json'}: field {error} is missing or of the wrong kind") from None
    truth = _read_truth(folder, setup)
    ticks = _DiskTicks(folder, setup, len(truth), files)
    provenance = {"scenario": read_json(folder / "scenario.json"), "manifest": _sha256((folder / "manifest.json").read_bytes())}
    return Sequence(setup, ticks, truth, provenance)


def _read_setup(folder: Path) -> Setup:
    calibration = read_json(folder / "calibration.json")
    try:
        with np.load(folder / "terrain.npz", allow_pickle=False) as terrain:
            origin, spacing = terrain["origin"], float(terrain["spacing"])
            ground, tops = Grid(terrain["heights"], origin, spacing), Grid(terrain["tops"], origin, spacing)
    except (OSError, EOFError, KeyError, ValueError, zipfile.BadZipFile, zlib.error) as error:
        raise ValueError(f"{folder / 'terrain.npz'}: {error}") from None
    mounts = {
        name: Mount(Panorama(entry["width"], entry["height"]), _pose_from(entry["T_body_camera"]), entry["robot"])
        for name, entry in calibration["cameras"].items()
    }
    starts = {
        name: Start(_pose_from(entry["T_world_robot"]), np.array(entry["covariance"])) if entry else None
        for name, entry in calibration["starts"].items()
    }
    low, high = calibration["height"]
    return Setup(mounts, ground, starts, calibration["period"], height=(low, high), occluders=tops)


def _rows_by_frame(
    path: Path, columns: dict[str, type], key: tuple[str, ...] = (), known_values: dict[str, Container[Any]] | None = None
) -> dict[int, list[dict[str, Any]]]:
    """Rows of a table by frame; `key` columns must tell the rows of a frame apart and values be known ones, else ValueError with the line."""
    table = read_table(path, columns)
    frames: dict[int, list[dict[str, Any]]] = {}
    seen = set()
    for line, values in enumerate(zip(*table.values(), strict=True), 2):
        row = dict(zip(columns, values, strict=True))
        for name, known in (known_values or {}).items():
            if row[name] not in known:
                raise ValueError(f"{path}:{line}: {name} is {row[name]}, the sequence does not have it")
        if key:
            identity = tuple(row[name] for name in ("frame", *key))
            if identity in seen:
                raise ValueError(f"{path}:{line}: frame {row['frame']} has {key[0]} {row[key[0]]} twice")
            seen.add(identity)
        frames.setdefault(int(row["frame"]), []).append(row)
    return frames


def _read_truth(folder: Path, setup: Setup) -> tuple[Truth, ...]:
    robots = _rows_by_frame(folder / "truth" / "robots.csv", ROBOTS, ("robot",), {"robot": setup.starts})
    people = _rows_by_frame(folder / "truth" / "people.csv", _people_columns(setup), ("person",))
    if sorted(robots) != list(range(len(robots))):
        raise ValueError(f"{folder / 'truth' / 'robots.csv'}: frames are not 0 to {len(robots) - 1} without a gap")
    for k, rows in robots.items():
        if len(rows) != len(setup.starts):
            raise ValueError(f"{folder / 'truth' / 'robots.csv'}: frame {k} has {len(rows)} robots, needs {len(setup.starts)}")
    visible = [f"visible_{camera}" for camera in setup.mounts]
    return tuple(
        Truth(
            k,
            {row["robot"]: _pose_from([row[c] for c in POSE]) for row in robots[k]},
            np.array([row["person"] for row in people.get(k, [])], dtype=np.int64),
            np.array([[row["x"], row["y"], row["z"]] for row in people.get(k, [])]).reshape(-1, 3),
            np.array([[row[c] for c in visible] for row in people.get(k, [])]).reshape(-1, len(visible)),
        )
        for k in range(len(robots))
    )


def read_boxes(folder: Path) -> dict[tuple[int, str], Boxes]:
    """True boxes by frame and camera."""
    frames = _rows_by_frame(folder / "truth" / "boxes.csv", BOXES, ("person", "camera"))
    found: dict[tuple[int, str], list[dict[str, Any]]] = {}
    for k, rows in frames.items():
        for row in rows:
            found.setdefault((k, row["camera"]), []).append(row)
    names = list(BOXES)[3:]
    return {
        key: Boxes(
            np.array([r["person"] for r in rows]),
            np.array([[r[c] for c in names[:4]] for r in rows]),
            np.array([[r[c] for c in names[4:8]] for r in rows]),
            np.array([r["visible"] for r in rows]),
        )
        for key, rows in found.items()
    }


class _DiskTicks:
    """Ticks of a folder; images are read when they are asked for."""

    def __init__(self, folder: Path, setup: Setup, count: int, files: dict[str, Any]) -> None:
        self.folder, self.setup, self.count, self.files = folder, setup, count, files
        frames = range(count)
        self._odometry = _rows_by_frame(folder / "odometry.csv", ODOMETRY, ("robot",), {"frame": frames, "robot": setup.starts})
        self._detections = _rows_by_frame(folder / "detections.csv", DETECTIONS, (), {"frame": frames, "camera": setup.mounts})

    def __len__(self) -> int:
        return self.count

    def odometry(self) -> Iterator[dict[str, Odometry]]:
        for k in range(self.count):
            yield {row["robot"]: _odometry(row) for row in self._odometry.get(k, [])}

    def __iter__(self) -> Iterator[Tick]:
        for k, odometry in enumerate(self.odometry()):
            boxes = self._detections.get(k, [])
            yield Tick(
                k,
                k * self.setup.period,
                tuple(
                    View(
                        name,
                        _detections([row for row in boxes if row["camera"] == name]),
                        odometry=odometry.get(mount.robot),
                        image=self._image(f"images/{name}/{k:06d}.jpg", mount),
                    )
                    for name, mount in self.setup.mounts.items()
                ),
            )

    def _image(self, name: str, mount: Mount) -> Image:
        path = self.folder / name
        if name not in self.files:
            raise ValueError(f"{path}: the manifest does not name it")
        data = path.read_bytes()
        if _sha256(data) != self.files[name]["sha256"]:
            raise ValueError(f"{path}: its SHA-256 is not the manifest's: truncated or changed")
        image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR) if data else None
        size = (mount.camera.height, mount.camera.width)
        if image is None or image.shape[:2] != size:
            raise ValueError(f"{path}: {'no image' if image is None else image.shape[:2]}, needs {size}")
        return np.ascontiguousarray(image[:, :, ::-1], dtype=np.uint8)


def _odometry(row: dict[str, Any]) -> Odometry:
    covariance = np.zeros((6, 6))
    for i, j in UPPER:
        covariance[i, j] = covariance[j, i] = row[f"c{i}{j}"]
    up = np.array([row["up_x"], row["up_y"], row["up_z"]])
    return Odometry(_pose_from([row[c] for c in POSE]), covariance, up if up.any() else None, float(row["up_sigma"]))


def _detections(rows: list[dict[str, Any]]) -> Detections:
    if not rows:
        return Detections.none()
    bearing = np.array([[r["bearing_x"], r["bearing_y"], r["bearing_z"]] for r in rows])
    return Detections(
        bearing / np.linalg.norm(bearing, axis=1, keepdims=True),
        np.array([[r["width"], r["height"]] for r in rows]),
        np.array([r["confidence"] for r in rows]),
        np.array([[[r["c00"], r["c01"]], [r["c01"], r["c11"]]] for r in rows]),
        np.zeros((len(rows), 0)),
    )
