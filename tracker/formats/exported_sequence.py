"""A recorded sequence for export: encoded images, instances, ground truth of each view, and detections as pixel boxes."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from tracker.detections.boxes import boxes_of_detections
from tracker.geometry import Array, Pose
from tracker.geometry.cameras import Camera
from tracker.io import image_files
from tracker.io.atomic import is_free, new_folder
from tracker.io.file_lock import folder_lock
from tracker.io.image_files import decode_image
from tracker.io.json_files import read_json
from tracker.io.mot15 import Mot15Rows, rows_from_boxes
from tracker.recordings import RecordingCamera
from tracker.sequence.calibration import pose_from
from tracker.sequence.reader import image_bytes, read_detections, read_robot_detections, read_sequence
from tracker.sequence.robot_sensors import read_imu, read_sensor_setup, read_stamps, read_wheels
from tracker.sequence.truth_tables import read_views
from tracker.types import Detections, ImuSamples, RobotDetections, Sequence, Setup, Truth, ViewTruth, WheelSamples

Progress = Callable[[Iterable[int], str], Iterable[int]]
"""Wraps the frames of a sequence, with its name, to show progress."""
JPEG, PNG = ".jpg", ".png"
OPENCV_CORNER = -0.5
"""px: u and v of the image's corner where the first pixel has its centre at (0, 0), as in OpenCV."""
IMU_FIELDS = ("rate", "gyro_noise", "gyro_walk", "force_noise", "force_walk")
"""Numbers of the IMU in sensors.json, in the order of ImuNoise."""


@contextmanager
def export_folder(source: Path, out: Path) -> Iterator[Path]:
    """Yields a temporary folder that becomes `out` when the block ends; its lock is held meanwhile.

    Raises ValueError for an `out` that is not empty or lies in `source`, and where another process writes into it.
    """
    if out.resolve().is_relative_to(source.resolve()):
        raise ValueError(f"{out}: lies in {source}, needs a place outside it")
    if not is_free(out):
        raise ValueError(f"{out}: is there already")
    with folder_lock(out), new_folder(out) as unfinished:
        yield unfinished


@dataclass(frozen=True, eq=False)
class ImuNoise:
    """rate Hz; gyro_noise rad/s/√Hz, gyro_walk rad/s²/√Hz, force_noise m/s²/√Hz, force_walk m/s³/√Hz; T_body_imu. Unknown numbers are 0."""

    rate: float
    gyro_noise: float
    gyro_walk: float
    force_noise: float
    force_walk: float
    T_body_imu: Pose


@dataclass(frozen=True, eq=False)
class RecordedSequence:
    """A sequence in a folder; images are read on demand. Reading raises ValueError with the path of a missing or damaged file."""

    folder: Path
    sequence: Sequence
    progress: Progress | None = None

    @staticmethod
    def open(folder: Path, progress: Progress | None = None) -> RecordedSequence:
        """Open a folder. Raises ValueError as read_sequence, and where the sequence has no ground truth."""
        sequence = read_sequence(folder)
        if sequence.truth is None:
            raise ValueError(f"{folder}: has no truth, which an export needs")
        return RecordedSequence(folder, sequence, progress)

    @property
    def name(self) -> str:
        """Name of the folder."""
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
        """Frames per second, rounded, since the reciprocal of the period is inexact."""
        return round(1 / self.setup.period, 9)

    def frames(self) -> Iterable[int]:
        """Indices of the frames from 0, wrapped by `progress`."""
        numbers = range(len(self.truth))
        return self.progress(numbers, self.name) if self.progress else numbers

    @property
    def cameras(self) -> dict[str, Camera]:
        return {name: mount.camera for name, mount in self.setup.mounts.items()}

    @cached_property
    def fixed(self) -> dict[str, RecordingCamera]:
        """The fixed cameras that are no panoramas, in the order of the sequence."""
        out = {}
        for name, mount in self.setup.mounts.items():
            start = self.setup.starts[mount.robot]
            if not mount.camera.wraps and start is not None and self.setup.is_fixed(mount.robot):
                out[name] = RecordingCamera(mount.camera, start.T_world_robot @ mount.T_body_camera)
        return out

    def require_fixed(self, form: str) -> dict[str, RecordingCamera]:
        """As `fixed`. Raises ValueError with advice where there is no such camera."""
        if not self.fixed:
            raise ValueError(
                f"{self.folder}: has no fixed pinhole camera, which {form} needs; generate the sequence with some (--views 4),"
                " or export panoramas as mot17, coco or jrdb"
            )
        return self.fixed

    @cached_property
    def views(self) -> dict[tuple[int, str], ViewTruth]:
        """(frame, camera) → ground truth of the view."""
        return read_views(self.folder)

    @cached_property
    def detections(self) -> dict[tuple[int, str], Detections]:
        """(frame, camera) → detections. Views without detections have no entry."""
        return read_detections(self.folder / "detections.csv", self.setup, range(len(self.truth)))

    @cached_property
    def robot_detections(self) -> dict[tuple[int, str], RobotDetections]:
        """(frame, camera) → other robots that are seen. Views that see none have no entry."""
        file = self.folder / "companions.csv"
        return read_robot_detections(file, self.setup, range(len(self.truth))) if file.name in self._files else {}

    def detection_boxes(self, frame: int, camera: str) -> tuple[Array, Array]:
        """Detected boxes (n, 4) left, top, width, height px from the corner of the image, and confidence (n,)."""
        found = self.detections.get((frame, camera), Detections.none())
        return boxes_of_detections(self.cameras[camera], found), found.confidence

    def camera_boxes(self, camera: str, origin: float) -> dict[int, tuple[Array, Array]]:
        """Frame from 0 → detected boxes (n, 4) px and confidence (n,), for frames with boxes. origin: u and v of the image's corner."""
        found = {frame: self.detection_boxes(frame, camera) for frame in range(len(self.truth))}
        corner = np.array([origin, origin, 0.0, 0.0])
        return {frame: (boxes + corner, confidence) for frame, (boxes, confidence) in found.items() if len(boxes)}

    def detection_rows(self, camera: str, origin: float) -> Mot15Rows:
        """The boxes of camera_boxes as rows of a MOT15 file."""
        return rows_from_boxes({frame + 1: boxes for frame, boxes in self.camera_boxes(camera, origin).items()})

    @cached_property
    def _files(self) -> dict[str, Any]:
        return dict(read_json(self.folder / "manifest.json")["files"])

    def _bytes(self, kind: str, camera: str, frame: int) -> tuple[bytes, Path]:
        return image_bytes(self.folder, f"{kind}/{camera}/{frame:06d}", self._files)

    def image(self, frame: int, camera: str, suffix: str = JPEG) -> bytes:
        """The image as the bytes of a JPEG or PNG file: those of the sequence if its format matches, else encoded again (quality 95)."""
        data, path = self._bytes("images", camera, frame)
        return data if path.suffix == suffix else self.encoded(self._decode(data, path, camera, cv2.IMREAD_COLOR), suffix)

    def has_images(self, camera: str) -> bool:
        """Whether the manifest names images of the camera."""
        return any(name.startswith(f"images/{camera}/") for name in self._files)

    def image_suffix(self, camera: str) -> str:
        """The suffix of the camera's image files, that of frame 0."""
        return JPEG if f"images/{camera}/{0:06d}{JPEG}" in self._files else PNG

    def pixels(self, frame: int, camera: str) -> NDArray[np.uint8]:
        """The decoded image (H, W, 3), blue, green, red. The last image is cached, because six faces read one panorama."""
        if (frame, camera) not in self._decoded:
            data, path = self._bytes("images", camera, frame)
            self._decoded.clear()
            self._decoded[frame, camera] = np.asarray(self._decode(data, path, camera, cv2.IMREAD_COLOR), dtype=np.uint8)
        return self._decoded[frame, camera]

    @cached_property
    def _decoded(self) -> dict[tuple[int, str], NDArray[np.uint8]]:
        return {}

    @staticmethod
    def encoded(pixels: NDArray[Any], suffix: str) -> bytes:
        """Pixels (H, W) or (H, W, 3), blue, green, red, as the bytes of a JPEG (quality 95) or PNG file."""
        return image_files.encoded(f"image{suffix}", pixels, _OPTIONS[suffix])

    def stamps(self, epoch: int = 0) -> list[int]:
        """Time of each frame in nanoseconds. epoch: the time of frame 0, whole seconds."""
        return [epoch * 10**9 + round(k * self.setup.period * 1e9) for k in range(len(self.truth))]

    def clock_stamps(self, clock: str, epoch: int = 0) -> list[int]:
        """Time of each frame in nanoseconds by the clock of a robot or camera; the true times where clocks have no errors.

        Raises ValueError for a time before 0, which ROS and EuRoC do not hold, and for a clock without a time in each frame.
        """
        if "stamps.csv" not in self._files:
            return self.stamps(epoch)
        rows = self._clocks.get(clock, np.zeros((0, 3)))
        if rows[:, 0].tolist() != list(range(len(self.truth))):
            raise ValueError(f"{self.folder / 'stamps.csv'}: {clock} has no time in each frame")
        return self.nanoseconds(rows[:, 2], epoch, clock)

    def nanoseconds(self, seconds: Array, epoch: int, clock: str) -> list[int]:
        """Times (n,) s of a clock since frame 0 as nanoseconds. Raises ValueError for a time before 0."""
        if (first := seconds.min(initial=0.0)) + epoch < 0:
            raise ValueError(f"{self.folder}: the clock of {clock} begins at {first:.3g} s, needs --epoch {int(np.ceil(-first))} or more")
        return [epoch * 10**9 + round(time * 1e9) for time in seconds.tolist()]

    @cached_property
    def _clocks(self) -> dict[str, Array]:
        return read_stamps(self.folder)

    @cached_property
    def imu(self) -> dict[str, ImuSamples]:
        """Robot → samples of its IMU; empty where the sequence has none."""
        return read_imu(self.folder) if "imu.csv" in self._files else {}

    @cached_property
    def wheels(self) -> dict[str, WheelSamples]:
        """Robot → samples of its wheel encoders; empty where the sequence has none."""
        return read_wheels(self.folder) if "wheels.csv" in self._files else {}

    def imu_noise(self, robot: str) -> ImuNoise:
        """The rate, place and noise of the IMU of a robot. Raises ValueError for invalid fields of sensors.json."""
        content = read_sensor_setup(self.folder).description.get("imu", {})
        try:
            told = content.get("T_body_imu_of_robots", {}).get(robot) or content.get("T_body_imu", [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
            rate, gyro, gyro_walk, force, force_walk = (float(content.get(name, 0.0)) for name in IMU_FIELDS)
            return ImuNoise(rate, gyro, gyro_walk, force, force_walk, pose_from(told))
        except (AttributeError, KeyError, TypeError, ValueError) as error:
            raise ValueError(f"{self.folder / 'sensors.json'}: imu: {error}") from None

    def true_poses(self, robot: str) -> list[Pose]:
        """T_world_robot of each frame."""
        return [t.T_world_robot[robot] for t in self.truth]

    def instances(self, frame: int, camera: str) -> NDArray[np.uint16]:
        """The instance image (H, W) of person ids, 0 for no person."""
        data, path = self._bytes("instances", camera, frame)
        image = self._decode(data, path, camera, cv2.IMREAD_UNCHANGED)
        if image.dtype != np.uint16 or image.ndim != 2:
            raise ValueError(f"{path}: is {image.dtype} {image.shape}, needs 16 bit, one channel")
        return image

    def _decode(self, data: bytes, path: Path, camera: str, flag: int) -> NDArray[np.uint16]:
        try:
            return decode_image(data, (self.cameras[camera].height, self.cameras[camera].width), flag)
        except ValueError as error:
            raise ValueError(f"{path}: {error}") from None


_OPTIONS = {JPEG: image_files.JPEG, PNG: image_files.PNG}


def ltwh_from_edges(edges: Array) -> Array:
    """Boxes (n, 4) left, top, right, bottom → left, top, width, height."""
    return np.column_stack([edges[:, :2], edges[:, 2:] - edges[:, :2]])
