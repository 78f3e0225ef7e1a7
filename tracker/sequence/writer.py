"""Writing a sequence into a folder; `reader.py` reads it.

README.md in that folder (schema.README) describes each file and column.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tracker.geometry import Image
from tracker.geometry.cameras import Tsai
from tracker.geometry.ground import Grid
from tracker.io.atomic import Kept, begin_folder, discard_folder, finish_folder, unfinished_path
from tracker.io.csv_tables import write_arrays, write_table
from tracker.io.image_files import JPEG, PNG, PNG_RUN_LENGTH, RANGE, ImageWriter, range_counts
from tracker.io.json_files import write_json
from tracker.io.resume import checksum
from tracker.io.tsai_xml import write_camera
from tracker.io.video_files import VideoWriters
from tracker.sequence.calibration import calibration_of, pose_row
from tracker.sequence.manifest import manifest_checksum
from tracker.sequence.robot_sensors import sample_rows, sensor_tables
from tracker.sequence.schema import (
    BOXES,
    CAMERAS,
    DETECTIONS,
    EFFECTS,
    EFFECTS_README,
    JOINTS,
    KEYPOINTS,
    ODOMETRY,
    PLACE_FILE,
    PLACE_README,
    README,
    ROBOT_DETECTIONS,
    ROBOTS,
    ROBOTS_README,
    ROWS,
    SCHEMA,
    SENSORS_README,
    SITTING_README,
    UPPER_TRIANGLE,
    people_columns,
)
from tracker.sequence.truth_tables import box_rows, camera_row, joint_rows, keypoint_rows
from tracker.types import Odometry, RobotDetections, SensorSamples, SensorSetup, Setup, Tick, Truth, View, ViewTruth

LARGE = 250_000
"""A table with more values than this is also written as NPZ."""


@dataclass(frozen=True)
class ImageForm:
    """Options of the written files. Tables, images (JPEG) and instance images are always written.

    png: lossless images replace JPEG. range, classes: an image of each for every view. video: an MP4 for each camera.
    mesh: the scene as terrain.glb.
    """

    png: bool = False
    range: bool = False
    classes: bool = False
    video: bool = False
    mesh: bool = False

    def folders(self) -> Iterable[str]:
        """Folders with a subfolder for each camera."""
        return ["images", "instances", *(["range"] if self.range else []), *(["classes"] if self.classes else [])]

    def colour_file(self, name: str) -> tuple[str, list[int]]:
        """Path of a colour image, and the options of its encoding. name: CAMERA/FRAME, as for all files of a view."""
        return (f"images/{name}.png", PNG) if self.png else (f"images/{name}.jpg", JPEG)

    def layer_files(
        self, name: str, instances: NDArray[np.uint16], ranges: NDArray[np.float32], classes: NDArray[np.uint8]
    ) -> Iterator[tuple[str, NDArray[Any], list[int]]]:
        """Path, pixels and options of encoding of the images of a view beside its colour image. name: CAMERA/FRAME.

        instances (H, W): person ids, 0 for no person. ranges (H, W): m along the ray, inf where no surface is hit. classes (H, W).
        """
        yield f"instances/{name}.png", instances, PNG_RUN_LENGTH
        if self.range:
            yield f"range/{name}.png", range_counts(ranges), RANGE
        if self.classes:
            yield f"classes/{name}.png", classes, PNG_RUN_LENGTH


def view_name(camera: str, frame: int) -> str:
    """The name CAMERA/FRAME of the files of a view, without suffix."""
    return f"{camera}/{frame:06d}"


def robot_detection_rows(frame: int, camera: str, seen: RobotDetections) -> list[list[Any]]:
    """The rows of companions.csv of a view."""
    named = zip(seen.robot, seen.bearing, seen.covariance, strict=True)
    return [[frame, camera, robot, *map(float, [*b, s[0, 0], s[0, 1], s[1, 1]])] for robot, b, s in named]


def odometry_row(frame: int, robot: str, odometry: Odometry) -> list[object]:
    """A row of odometry.csv, in the order of schema.ODOMETRY; up is 0 where gravity is unknown."""
    up = [*map(float, odometry.gravity), odometry.gravity_sigma] if odometry.gravity is not None else [0.0, 0.0, 0.0, 0.0]
    return [frame, robot, *pose_row(odometry.T_before_now), *up, *(float(odometry.covariance[i, j]) for i, j in UPPER_TRIANGLE)]


class SequenceWriter:
    """Writes a sequence under a temporary name until `finish` renames it. As a context manager it removes unfinished files.

    Unfinished files stay after an OSError, for instance of a full disk. The context raises Kept then, which names their place.
    tops: height map of walls and furniture on the grid of the ground. sensors: of the robots, beside cameras and odometry.
    `images` encodes and writes the images, below the temporary folder. `resumed`: whether that folder is used again, with the images in it.
    `resumable`: whether unfinished files stay after an interrupt, too.
    """

    def __init__(self, folder: Path, setup: Setup, tops: Grid, form: ImageForm | None = None, sensors: SensorSetup | None = None) -> None:
        self.resumed = self.resumable = False
        self.folder, self.setup, self.form = folder, setup, form or ImageForm()
        self.partial = unfinished_path(folder)
        self.tops, self.sensors = tops, sensors
        self.images = ImageWriter(self.partial)
        self._videos = VideoWriters(self.partial / "videos", 1 / setup.period) if self.form.video else None
        self._has_robot_detections = self._says_who_sits = False
        self._true_setup = setup
        self._effect_tables: dict[str, list[str]] = {}
        self._rows: dict[str, list[list[object]]] = {name.split("/")[-1]: [] for name in self._tables()}
        if sensors and sensors.clocks:
            self._rows["clocks"] = [[name, *errors] for name, errors in sensors.clocks.items()]

    def _tables(self) -> dict[str, list[str]]:
        """Table → its columns."""
        truth: dict[str, dict[str, type]] = {"robots": ROBOTS, "cameras": CAMERAS, "boxes": BOXES, "keypoints": KEYPOINTS, "joints": JOINTS}
        truth["people"] = people_columns(self.setup.mounts, self._says_who_sits)
        measured = {"odometry": list(ODOMETRY), "detections": list(DETECTIONS), "companions": list(ROBOT_DETECTIONS)}
        tables = measured | {f"truth/{name}": list(columns) for name, columns in truth.items()}
        return tables | (sensor_tables(self.sensors) if self.sensors else {}) | self._effect_tables

    def add_effects(self, rows: list[list[object]], true_setup: Setup, moves: bool) -> None:
        """Add the errors of the cameras: rows of truth/effects.csv, and the setup without errors.

        moves: whether there is a truth/rows.csv. Call it before frames are added.
        """
        self._true_setup = true_setup
        self._effect_tables = {"truth/effects": list(EFFECTS)} | ({"truth/rows": list(ROWS)} if moves else {})
        self._rows |= {"effects": rows, "rows": []}

    def add_rows(self, rows: list[list[object]]) -> None:
        """Append rows of truth/rows.csv. Nothing happens without any."""
        if rows:
            self._rows["rows"] += rows

    def __enter__(self) -> SequenceWriter:
        if not self.resumed:
            begin_folder(self.folder)
        (self.partial / "truth").mkdir(exist_ok=True)
        for camera in self.setup.mounts:
            for folder in self.form.folders():
                (self.partial / folder / camera).mkdir(parents=True, exist_ok=True)
        ground = self.setup.ground
        assert isinstance(ground, Grid)
        np.savez(self.partial / "terrain.npz", heights=ground.heights, origin=ground.origin, spacing=ground.spacing, tops=self.tops.heights)
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.images.close()
        if self._videos:
            self._videos.close()
        if isinstance(error, OSError) and self.partial.is_dir():
            raise Kept.of(error, self.partial) from error
        if isinstance(error, KeyboardInterrupt) and self.resumable:
            return
        discard_folder(self.partial)

    def add(self, tick: Tick, truth: Truth, views: Mapping[str, ViewTruth]) -> None:
        """Append one tick with its truth. views: camera → ground truth of the view. The caller adds the images.

        Raises ValueError for a truth without joints.
        """
        k, rows = tick.index, self._rows
        self._says_who_sits = truth.sitting is not None
        for view in tick.views:
            self._add_measurements(k, view)
            true = views[view.camera]
            rows["cameras"].append(camera_row(k, view.camera, true))
            rows["boxes"] += box_rows(k, view.camera, true.boxes)
            rows["keypoints"] += keypoint_rows(k, view.camera, true.keypoints)
        rows["robots"] += [[k, robot, *pose_row(pose), int(robot in truth.tipped)] for robot, pose in truth.T_world_robot.items()]
        for person, feet, fractions in zip(truth.person_id, truth.feet, truth.visible, strict=True):
            sits = [] if truth.sitting is None else [int(person in truth.sitting)]
            rows["people"].append([k, int(person), *map(float, feet), *map(float, fractions), *sits])
        if truth.joints is None:
            raise ValueError(f"truth of frame {k} has no joints, needs them")
        rows["joints"] += joint_rows(k, truth.person_id, truth.joints)

    def add_samples(self, frame: int, samples: SensorSamples) -> None:
        """Append the samples of the robots' own sensors since the frame before."""
        for name, rows in sample_rows(frame, samples):
            self._rows[name].extend(rows)

    def _add_measurements(self, k: int, view: View) -> None:
        """Add the rows of odometry, detections and robot detections of a view."""
        if view.odometry is not None:
            self._rows["odometry"].append(odometry_row(k, self.setup.mounts[view.camera].robot, view.odometry))
        d = view.detections
        for b, e, c, s in zip(d.bearing, d.extent, d.confidence, d.covariance, strict=True):
            self._rows["detections"].append([k, view.camera, *map(float, [*b, *e, c, s[0, 0], s[0, 1], s[1, 1]])])
        if view.robot_detections is not None:
            self._has_robot_detections, seen = True, view.robot_detections
            self._rows["companions"].extend(robot_detection_rows(k, view.camera, seen))

    def add_image(self, frame: int, camera: str, image: Image) -> str:
        """Queue the RGB image of a view, for its file and for the video, and return the path of the file."""
        path, options = self.form.colour_file(view_name(camera, frame))
        self.images.put(path, image[:, :, ::-1], options)
        if self._videos:
            self._videos.put(camera, image)
        return path

    def finish(self, provenance: dict[str, Any], versions: dict[str, str]) -> None:
        """Write tables, calibration and manifest, and rename the folder.

        provenance: content of scenario.json. versions: program → version.
        """
        self.images.wait()
        if self._videos:
            self._videos.finish()
        root = self.partial
        for name, columns in self._tables().items():
            if name == "companions" and not self._has_robot_detections:
                continue
            rows = self._rows[name.split("/")[-1]]
            write_table(root / f"{name}.csv", columns, rows)
            if len(rows) * len(columns) > LARGE:
                write_arrays(root / f"{name}.npz", columns, rows)
        self._write_calibrations()
        notes = SITTING_README if self._says_who_sits else ""
        notes += (SENSORS_README if self.sensors else "") + (EFFECTS_README if self._effect_tables else "")
        own_robots = any(mount.own_body is not None for mount in self.setup.mounts.values())
        notes += ROBOTS_README if own_robots or (self.sensors and "T_body_imu_of_robots" in self.sensors.description.get("imu", {})) else ""
        notes += PLACE_README if (root / PLACE_FILE).is_file() else ""
        (root / "README.md").write_text(README + notes, encoding="utf-8")
        if self.sensors and self.sensors.description:
            write_json(root / "sensors.json", dict(self.sensors.description), indent=1)
        write_json(root / "scenario.json", provenance, indent=1)
        write_json(root / "calibration.json", calibration_of(self.setup), indent=1)
        if self._true_setup is not self.setup:
            write_json(root / "truth" / "calibration.json", calibration_of(self._true_setup), indent=1)
        paths = [path.relative_to(root).as_posix() for path in sorted(root.rglob("*")) if path.is_file()]
        sums = {name: self.images.checksums.get(name) or (checksum(root / name), (root / name).stat().st_size) for name in paths}
        files = {name: {"sha256": sha256, "bytes": size} for name, (sha256, size) in sums.items()}
        manifest = {"schema": SCHEMA, "versions": versions, "files": files}
        write_json(root / "manifest.json", manifest | {"sum": manifest_checksum(manifest)}, indent=1)
        finish_folder(self.folder, self.partial)

    def _write_calibrations(self) -> None:
        """Write a calibration file of PETS 2009 for each fixed Tsai camera."""
        for name, mount in self.setup.mounts.items():
            start = self.setup.starts[mount.robot]
            if isinstance(mount.camera, Tsai) and start is not None and self.setup.is_fixed(mount.robot):
                (self.partial / "calibration").mkdir(exist_ok=True)
                write_camera(self.partial / "calibration" / f"{name}.xml", name, mount.camera, start.T_world_robot @ mount.T_body_camera)
