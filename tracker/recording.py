"""Writing a Sequence into a folder; tracker/sequence.py reads it.

The folder's own README.md (layout.README) says what every file and column is.
"""

from __future__ import annotations

import hashlib
import json
import shutil
from collections import deque
from collections.abc import Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from types import TracebackType
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from tracker.annotations import ViewTruth, box_rows, camera_row, joint_rows, keypoint_rows
from tracker.calibration import calibration_of, pose_row
from tracker.cameras import Tsai
from tracker.formats.pets2009 import write_camera
from tracker.ground import Grid
from tracker.layout import BOXES, CAMERAS, DETECTIONS, JOINTS, KEYPOINTS, ODOMETRY, README, ROBOTS, SCHEMA, UPPER, people_columns
from tracker.measurements import Setup, Tick, Truth, View
from tracker.tables import write_table

CODERS, WAITING = 2, 24
"""Threads that code images, and how many images may wait for them."""


class SequenceWriter:
    """Writes a Sequence under a temporary name; only `finish` gives it its own. As a context it cleans up after an error."""

    def __init__(self, folder: Path, setup: Setup, tops: Grid) -> None:
        self.folder, self.setup = folder, setup
        self.partial = folder.with_name(f".{folder.name}.partial")
        self.tops = tops
        # Images are coded while the next ones are drawn: OpenCV lets go of the interpreter.
        self._coders = ThreadPoolExecutor(CODERS)
        self._coding: deque[Future[None]] = deque()
        self._rows: dict[str, list[list[object]]] = {name.split("/")[-1]: [] for name in self._tables()}

    def _tables(self) -> dict[str, list[str]]:
        """Table → its columns."""
        truth: dict[str, dict[str, type]] = {"robots": ROBOTS, "cameras": CAMERAS, "boxes": BOXES, "keypoints": KEYPOINTS, "joints": JOINTS}
        truth["people"] = people_columns(self.setup.mounts)
        return {"odometry": list(ODOMETRY), "detections": list(DETECTIONS)} | {f"truth/{name}": list(columns) for name, columns in truth.items()}

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
        self._coders.shutdown(cancel_futures=True)
        if self.partial.exists():
            shutil.rmtree(self.partial)

    def add(self, tick: Tick, truth: Truth, instances: Mapping[str, NDArray[np.uint16]], views: Mapping[str, ViewTruth]) -> None:
        """Append one tick; by camera the instances (H, W) uint16 and what is true of the view.

        Raises ValueError for a view without an image, an image that cannot be written, or a truth without joints.
        """
        k, rows = tick.index, self._rows
        for view in tick.views:
            if view.image is None:
                raise ValueError(f"frame {k} of {view.camera} has no image, needs one")
            self._measured(k, view)
            self._image(Path("images", view.camera, f"{k:06d}.jpg"), view.image[:, :, ::-1], [cv2.IMWRITE_JPEG_QUALITY, 95])
            self._image(Path("instances", view.camera, f"{k:06d}.png"), instances[view.camera], [cv2.IMWRITE_PNG_COMPRESSION, 1])
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
        """Odometry and detections of a view."""
        if view.odometry is not None:
            o, robot = view.odometry, self.setup.mounts[view.camera].robot
            up = [*map(float, o.gravity), o.gravity_sigma] if o.gravity is not None else [0.0, 0.0, 0.0, 0.0]
            self._rows["odometry"].append([k, robot, *pose_row(o.T_before_now), *up, *(float(o.covariance[i, j]) for i, j in UPPER)])
        d = view.detections
        for b, e, c, s in zip(d.bearing, d.extent, d.confidence, d.covariance, strict=True):
            self._rows["detections"].append([k, view.camera, *map(float, [*b, *e, c, s[0, 0], s[0, 1], s[1, 1]])])

    def _image(self, name: Path, image: Any, options: list[int]) -> None:
        """Have an image coded and written, after as many others are done as would else pile up."""
        self._coding.append(self._coders.submit(self._code, name, image, options))
        while len(self._coding) > WAITING:
            self._coding.popleft().result()

    def _code(self, name: Path, image: Any, options: list[int]) -> None:
        ok, data = cv2.imencode(name.suffix, image, options)
        if not ok:
            raise ValueError(f"{name}: this image cannot be written as {name.suffix}")
        (self.partial / name).write_bytes(data.tobytes())

    def finish(self, provenance: dict[str, Any], versions: dict[str, str]) -> None:
        """Write tables, calibration and manifest, and give the folder its name."""
        while self._coding:
            self._coding.popleft().result()
        root = self.partial
        for name, columns in self._tables().items():
            write_table(root / f"{name}.csv", columns, self._rows[name.split("/")[-1]])
        self._calibrate()
        (root / "README.md").write_text(README, encoding="utf-8")
        _write_json(root / "scenario.json", provenance)
        _write_json(root / "calibration.json", calibration_of(self.setup))
        files = {
            path.relative_to(root).as_posix(): {"sha256": hashlib.sha256(path.read_bytes()).hexdigest(), "bytes": path.stat().st_size}
            for path in sorted(root.rglob("*"))
            if path.is_file()
        }
        _write_json(root / "manifest.json", {"schema": SCHEMA, "versions": versions, "files": files})
        root.rename(self.folder)

    def _calibrate(self) -> None:
        """The file of PETS 2009 of every Tsai camera whose place is known and stays."""
        for name, mount in self.setup.mounts.items():
            start = self.setup.starts[mount.robot]
            if isinstance(mount.camera, Tsai) and start is not None and not start.covariance.any():
                (self.partial / "calibration").mkdir(exist_ok=True)
                write_camera(self.partial / "calibration" / f"{name}.xml", name, mount.camera, start.T_world_robot @ mount.T_body_camera)


def _write_json(path: Path, value: object) -> None:
    path.write_text(json.dumps(value, indent=1, allow_nan=False) + "\n", encoding="utf-8")


