"""A Sequence as exporters read it: images as coded bytes, instances, truth of every view, detections as pixel boxes. Images stay on disk."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from tracker.geometry import Array, Pose, angles_from_bearing, bearing_from_angles
from tracker.geometry.cameras import Camera, Panorama, Tsai
from tracker.io import image_files
from tracker.io.csv_tables import read_table
from tracker.io.image_files import decode
from tracker.io.json_files import read_json
from tracker.sequence.reader import read_sequence
from tracker.sequence.schema import DETECTIONS
from tracker.sequence.truth_tables import read_views
from tracker.types import Detections, Sequence, Setup, Truth, ViewTruth

Progress = Callable[[Iterable[int], str], Iterable[int]]
"""Wraps the frames of a sequence of that name, to show how far it is."""
JPEG, PNG = ".jpg", ".png"
STEPS = 60
"""Iterations for the width of a detection; each leaves a few per cent of the error."""


@dataclass(frozen=True, eq=False)
class FixedView:
    """A pinhole camera that stands still."""

    camera: Tsai
    T_world_camera: Pose


@dataclass(frozen=True, eq=False)
class RecordedSequence:
    """One Sequence in a folder. Raises ValueError, where something is read, that names the file which is missing or damaged."""

    folder: Path
    sequence: Sequence
    progress: Progress | None = None

    @staticmethod
    def open(folder: Path, progress: Progress | None = None) -> RecordedSequence:
        """Raises ValueError as read_sequence, and where the sequence has no truth."""
        sequence = read_sequence(folder)
        if sequence.truth is None:
            raise ValueError(f"{folder}: has no truth, there is nothing to export")
        return RecordedSequence(folder, sequence, progress)

    @property
    def name(self) -> str:
        """Of the folder, without what a path could trip over."""
        return self.folder.resolve().name

    @property
    def setup(self) -> Setup:
        return self.sequence.setup

    @property
    def truth(self) -> tuple[Truth, ...]:
        assert self.sequence.truth is not None
        return self.sequence.truth

    @property
    def rate(self) -> float:
        """Frames a second, without the noise of 1 / (1 / 6)."""
        return round(1 / self.setup.period, 9)

    def frames(self) -> Iterable[int]:
        """Indices from 0, with progress."""
        numbers = range(len(self.truth))
        return self.progress(numbers, self.name) if self.progress else numbers

    @property
    def cameras(self) -> dict[str, Camera]:
        return {name: mount.camera for name, mount in self.setup.mounts.items()}

    @cached_property
    def fixed(self) -> dict[str, FixedView]:
        """The pinhole cameras whose place is known and stays, in the order of the sequence."""
        out = {}
        for name, mount in self.setup.mounts.items():
            start = self.setup.starts[mount.robot]
            if isinstance(mount.camera, Tsai) and start is not None and self.setup.is_fixed(mount.robot):
                out[name] = FixedView(mount.camera, start.T_world_robot @ mount.T_body_camera)
        return out

    def needs_fixed(self, form: str) -> dict[str, FixedView]:
        """As `fixed`; raises ValueError, with what to do, where there is none."""
        if not self.fixed:
            raise ValueError(
                f"{self.folder}: has no fixed pinhole camera, and {form} knows no other; generate the sequence with some (--views 4),"
                " or export panoramas as mot17, coco or jrdb"
            )
        return self.fixed

    @cached_property
    def views(self) -> dict[tuple[int, str], ViewTruth]:
        """(frame, camera) → all that is true of that view."""
        return read_views(self.folder)

    @cached_property
    def detections(self) -> dict[tuple[int, str], Detections]:
        """(frame, camera) → what the detector reported; views without a report are not there."""
        table = read_table(self.folder / "detections.csv", DETECTIONS)
        columns = np.column_stack([table[name] for name in list(DETECTIONS)[2:]]).reshape(-1, 9)
        found: dict[tuple[int, str], list[int]] = {}
        for row, key in enumerate(zip(table["frame"].tolist(), table["camera"].tolist(), strict=True)):
            found.setdefault(key, []).append(row)
        out = {}
        for key, rows in found.items():
            c = columns[rows]
            bearing = c[:, :3] / np.linalg.norm(c[:, :3], axis=1, keepdims=True)
            covariance = c[:, [6, 7, 7, 8]].reshape(-1, 2, 2)
            out[key] = Detections(bearing, c[:, 3:5], c[:, 5], covariance, np.zeros((len(c), 0)))
        return out

    def detected(self, frame: int, camera: str) -> tuple[Array, Array]:
        """Reported boxes (n, 4) left, top, width, height px from the image's corner, and confidence (n,)."""
        found = self.detections.get((frame, camera), Detections.none())
        return boxes_of_detections(self.cameras[camera], found), found.confidence

    @cached_property
    def _sums(self) -> dict[str, str]:
        return {name: entry["sha256"] for name, entry in read_json(self.folder / "manifest.json")["files"].items()}

    def _bytes(self, kind: str, camera: str, frame: int) -> tuple[bytes, str]:
        stem = f"{kind}/{camera}/{frame:06d}"
        suffix = next((s for s in (JPEG, PNG) if stem + s in self._sums), None)
        if suffix is None:
            raise ValueError(f"{self.folder / stem}: the manifest does not name it, neither {JPEG} nor {PNG}")
        data = (self.folder / (stem + suffix)).read_bytes()
        if hashlib.sha256(data).hexdigest() != self._sums[stem + suffix]:
            raise ValueError(f"{self.folder / (stem + suffix)}: its SHA-256 is not the manifest's: truncated or changed")
        return data, suffix

    def image(self, frame: int, camera: str, suffix: str = JPEG) -> bytes:
        """The image, coded as JPEG or PNG: the sequence's own bytes where they are of that kind, else coded anew (quality 95)."""
        data, own = self._bytes("images", camera, frame)
        if own == suffix:
            return data
        done, coded = cv2.imencode(suffix, self._decoded(data, camera, cv2.IMREAD_COLOR), _OPTIONS[suffix])
        assert done
        return bytes(coded.tobytes())

    def instances(self, frame: int, camera: str) -> NDArray[np.uint16]:
        """(H, W): the person's id, 0 for nobody."""
        image = self._decoded(self._bytes("instances", camera, frame)[0], camera, cv2.IMREAD_UNCHANGED)
        if image.dtype != np.uint16 or image.ndim != 2:
            raise ValueError(f"{self.folder}: instances of {camera} in frame {frame} are {image.dtype} {image.shape}, need 16 bit, one channel")
        return image

    def _decoded(self, data: bytes, camera: str, flag: int) -> NDArray[np.uint16]:
        try:
            return decode(data, (self.cameras[camera].height, self.cameras[camera].width), flag)
        except ValueError as error:
            raise ValueError(f"{self.folder}: an image of {camera}: {error}") from None


_OPTIONS = {JPEG: image_files.JPEG, PNG: image_files.PNG}


def boxes_of_detections(camera: Camera, detections: Detections) -> Array:
    """Detections → boxes (n, 4) left, top, width, height px from the image's corner: what boxes.detections_from_boxes takes, undone.

    In a panorama left lies in [0, W) and left + width may pass W. In a pinhole the box has its azimuth in the middle of its columns, and its
    width is the one that spans the reported azimuth in the middle of its height.
    """
    if not len(detections):
        return np.zeros((0, 4))
    azimuth, elevation = angles_from_bearing(detections.bearing)
    span, rise = detections.extent.T
    if isinstance(camera, Panorama):
        a_radian = camera.height / np.pi
        left = np.mod((np.pi - azimuth - span / 2) * a_radian, camera.width)
        return np.column_stack([left, (np.pi / 2 - elevation - rise / 2) * a_radian, span * a_radian, rise * a_radian])
    pixels = [camera.pixels_from_bearings(bearing_from_angles(azimuth, elevation + side * rise / 2))[0] for side in (-1, 1)]
    # Where a distortion has no way back, the upper edge is out of the image.
    (u, bottom), top = pixels[0].T, np.nan_to_num(pixels[1][:, 1], nan=camera.pixel_centre - 0.5)
    waist = (top + bottom) / 2

    def spanned(width: Array) -> Array:
        left, right = (angles_from_bearing(camera.bearings_from_pixels(np.column_stack([u + s * width / 2, waist])))[0] for s in (-1, 1))
        return np.asarray(left - right)

    width = bottom - top
    for _ in range(STEPS):
        width = width * span / spanned(width)
    return np.column_stack([u - width / 2, top, width, bottom - top]) + np.array([0.5 - camera.pixel_centre] * 2 + [0.0, 0.0])


def sized(edges: Array) -> Array:
    """(n, 4) left, top, right, bottom → left, top, width, height."""
    return np.column_stack([edges[:, :2], edges[:, 2:] - edges[:, :2]])
