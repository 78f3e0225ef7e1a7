"""Writing a Sequence into a folder; tracker/sequence/reader.py reads it.

The folder's own README.md (layout.README) says what every file and column is.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tracker.formats.pets2009 import write_camera
from tracker.geometry import Image
from tracker.geometry.cameras import Tsai
from tracker.geometry.ground import Grid
from tracker.io.atomic import begin_folder, discard_folder, finish_folder, unfinished
from tracker.io.csv_tables import write_arrays, write_table
from tracker.io.image_files import JPEG, PNG, RANGE, RUNS, Coders, range_counts
from tracker.io.video_files import Videos
from tracker.sequence.calibration import calibration_of, pose_row
from tracker.sequence.manifest import manifest_sum
from tracker.sequence.schema import BOXES, CAMERAS, COMPANIONS, DETECTIONS, JOINTS, KEYPOINTS, ODOMETRY, README, ROBOTS, SCHEMA, UPPER, people_columns
from tracker.sequence.truth_tables import box_rows, camera_row, joint_rows, keypoint_rows
from tracker.types import Setup, Tick, Truth, View, ViewTruth

LARGE = 250_000
"""Numbers from which on a table is there as NPZ too."""


@dataclass(frozen=True)
class ImageForm:
    """What is written beside tables, JPEG and instances: png, images without loss in place of JPEG; range and classes, an image of each for
    every image; video, an MP4 of every camera; mesh, the scene as terrain.glb."""

    png: bool = False
    range: bool = False
    classes: bool = False
    video: bool = False
    mesh: bool = False

    def folders(self) -> Iterable[str]:
        """Folders that hold one of every camera."""
        return ["images", "instances", *(["range"] if self.range else []), *(["classes"] if self.classes else [])]


@dataclass(frozen=True, eq=False)
class Layers:
    """By camera: instances (H, W) uint16; range (H, W) float32 m along the ray, inf for nothing, and classes (H, W) uint8 where the form wants
    them."""

    instances: Mapping[str, NDArray[np.uint16]]
    range: Mapping[str, NDArray[np.float32]] | None = None
    classes: Mapping[str, NDArray[np.uint8]] | None = None


class SequenceWriter:
    """Writes a Sequence under a temporary name; only `finish` gives it its own. As a context it cleans up after an error."""

    def __init__(self, folder: Path, setup: Setup, tops: Grid, form: ImageForm | None = None) -> None:
        self.folder, self.setup, self.form = folder, setup, form or ImageForm()
        self.partial = unfinished(folder)
        self.tops = tops
        self._coders = Coders(self.partial)
        self._videos = Videos(self.partial / "videos", 1 / setup.period) if self.form.video else None
        self._looked = False  # whether any view was searched for other robots
        self._rows: dict[str, list[list[object]]] = {name.split("/")[-1]: [] for name in self._tables()}

    def _tables(self) -> dict[str, list[str]]:
        """Table → its columns."""
        truth: dict[str, dict[str, type]] = {"robots": ROBOTS, "cameras": CAMERAS, "boxes": BOXES, "keypoints": KEYPOINTS, "joints": JOINTS}
        truth["people"] = people_columns(self.setup.mounts)
        measured = {"odometry": list(ODOMETRY), "detections": list(DETECTIONS), "companions": list(COMPANIONS)}
        return measured | {f"truth/{name}": list(columns) for name, columns in truth.items()}

    def __enter__(self) -> SequenceWriter:
        (begin_folder(self.folder) / "truth").mkdir()
        for camera in self.setup.mounts:
            for folder in self.form.folders():
                (self.partial / folder / camera).mkdir(parents=True)
        ground = self.setup.ground
        assert isinstance(ground, Grid)
        np.savez(self.partial / "terrain.npz", heights=ground.heights, origin=ground.origin, spacing=ground.spacing, tops=self.tops.heights)
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self._coders.close()
        if self._videos:
            self._videos.close()
        discard_folder(self.folder)

    def add(self, tick: Tick, truth: Truth, layers: Layers, views: Mapping[str, ViewTruth]) -> None:
        """Append one tick, its layers, and by camera what is true of the view.

        Raises ValueError for a view without an image, an image that cannot be written, or a truth without joints.
        """
        k, rows = tick.index, self._rows
        for view in tick.views:
            if view.image is None:
                raise ValueError(f"frame {k} of {view.camera} has no image, needs one")
            self._measured(k, view)
            self._images(k, view.camera, view.image, layers)
            true = views[view.camera]
            rows["cameras"].append(camera_row(k, view.camera, true))
            rows["boxes"] += box_rows(k, view.camera, true.boxes)
            rows["keypoints"] += keypoint_rows(k, view.camera, true.keypoints)
        rows["robots"] += [[k, robot, *pose_row(pose), int(robot in truth.tipped)] for robot, pose in truth.T_world_robot.items()]
        for person, feet, fractions in zip(truth.person_id, truth.feet, truth.visible, strict=True):
            rows["people"].append([k, int(person), *map(float, feet), *map(float, fractions)])
        if truth.joints is None:
            raise ValueError(f"truth of frame {k} has no joints, needs them")
        rows["joints"] += joint_rows(k, truth.person_id, truth.joints)

    def _measured(self, k: int, view: View) -> None:
        """Odometry, detections and companions of a view."""
        if view.odometry is not None:
            o, robot = view.odometry, self.setup.mounts[view.camera].robot
            up = [*map(float, o.gravity), o.gravity_sigma] if o.gravity is not None else [0.0, 0.0, 0.0, 0.0]
            self._rows["odometry"].append([k, robot, *pose_row(o.T_before_now), *up, *(float(o.covariance[i, j]) for i, j in UPPER)])
        d = view.detections
        for b, e, c, s in zip(d.bearing, d.extent, d.confidence, d.covariance, strict=True):
            self._rows["detections"].append([k, view.camera, *map(float, [*b, *e, c, s[0, 0], s[0, 1], s[1, 1]])])
        if view.companions is not None:
            self._looked, seen = True, view.companions
            for robot, b, s in zip(seen.robot, seen.bearing, seen.covariance, strict=True):
                self._rows["companions"].append([k, view.camera, robot, *map(float, [*b, s[0, 0], s[0, 1], s[1, 1]])])

    def _images(self, k: int, camera: str, image: Image, layers: Layers) -> None:
        """Have all images of a view written. Raises ValueError where the form wants a layer that is not there."""
        name, put = f"{camera}/{k:06d}", self._coders.put
        put(f"images/{name}.png" if self.form.png else f"images/{name}.jpg", image[:, :, ::-1], PNG if self.form.png else JPEG)
        put(f"instances/{name}.png", layers.instances[camera], RUNS)
        for layer, wanted, of in (("range", self.form.range, layers.range), ("classes", self.form.classes, layers.classes)):
            if wanted and of is None:
                raise ValueError(f"frame {k} has no {layer}, needs it")
        if self.form.range and layers.range is not None:
            put(f"range/{name}.png", range_counts(layers.range[camera]), RANGE)
        if self.form.classes and layers.classes is not None:
            put(f"classes/{name}.png", layers.classes[camera], RUNS)
        if self._videos:
            self._videos.put(camera, image)

    def finish(self, provenance: dict[str, Any], versions: dict[str, str]) -> None:
        """Write tables, calibration and manifest, and give the folder its name."""
        self._coders.wait()
        if self._videos:
            self._videos.finish()
        root = self.partial
        for name, columns in self._tables().items():
            if name == "companions" and not self._looked:
                continue
            rows = self._rows[name.split("/")[-1]]
            write_table(root / f"{name}.csv", columns, rows)
            if len(rows) * len(columns) > LARGE:
                write_arrays(root / f"{name}.npz", columns, rows)
        self._calibrate()
        (root / "README.md").write_text(README, encoding="utf-8")
        _write_json(root / "scenario.json", provenance)
        _write_json(root / "calibration.json", calibration_of(self.setup))
        paths = [path.relative_to(root).as_posix() for path in sorted(root.rglob("*")) if path.is_file()]
        sums = {name: self._coders.sums.get(name) or _sum(root / name) for name in paths}
        files = {name: {"sha256": sha256, "bytes": size} for name, (sha256, size) in sums.items()}
        manifest = {"schema": SCHEMA, "versions": versions, "files": files}
        _write_json(root / "manifest.json", manifest | {"sum": manifest_sum(manifest)})
        finish_folder(self.folder)

    def _calibrate(self) -> None:
        """The file of PETS 2009 of every Tsai camera whose place is known and stays."""
        for name, mount in self.setup.mounts.items():
            start = self.setup.starts[mount.robot]
            if isinstance(mount.camera, Tsai) and start is not None and not start.covariance.any():
                (self.partial / "calibration").mkdir(exist_ok=True)
                write_camera(self.partial / "calibration" / f"{name}.xml", name, mount.camera, start.T_world_robot @ mount.T_body_camera)


def _sum(path: Path) -> tuple[str, int]:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest(), path.stat().st_size


def _write_json(path: Path, value: object) -> None:
    path.write_text(json.dumps(value, indent=1, allow_nan=False) + "\n", encoding="utf-8")
