"""Camera parameters in the conventions of OpenCV, ROS, EuRoC and COLMAP, and resampling to pinholes for formats without other models.

Images are resampled into another camera with the same centre: the six faces of a cube around a panoramic camera, or a straight pinhole.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from tracker.formats.exported_sequence import RecordedSequence
from tracker.geometry import Array, Pose
from tracker.geometry.cameras import OPTICAL_FROM_CAMERA, Camera, Cylinder, Fisheye, Panorama, PanoramicCamera, Pinhole, Tsai
from tracker.geometry.poses import rotation_z
from tracker.geometry.tsai import opencv_intrinsics

OPTICAL = Pose(OPTICAL_FROM_CAMERA.T, np.zeros(3))
"""T_camera_optical: from the optical frame (x right, y down, z ahead) to the camera's (x forward, y left, z up)."""
_UP = np.array([[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])
FACES: dict[str, Array] = {
    "front": rotation_z(0.0),
    "left": rotation_z(np.pi / 2).round(),
    "back": rotation_z(np.pi).round(),
    "right": rotation_z(-np.pi / 2).round(),
    "up": _UP,
    "down": _UP.T,
}
"""Name of a face → R_camera_face (3, 3), both frames x forward, y left, z up. The left of `up` and `down` is the left of the camera."""
FARTHEST_OUT = -9.0
"""px: source column and row of a target pixel outside the view of the source. Pixels outside the source image are black."""


@dataclass(frozen=True)
class CameraParameters:
    """Parameters of a camera. The first pixel's centre is (0, 0).

    model: pinhole, fisheye, equirectangular or cylindrical. fx, fy, cx, cy: px, for panoramas as in PANORAMAS.
    distortion: k1, k2, p1, p2, k3 of a pinhole, k1 to k4 of a fisheye, as OpenCV has them.
    error: px, the largest error of these numbers over the image.
    """

    model: str
    fx: float
    fy: float
    cx: float
    cy: float
    distortion: tuple[float, ...] = ()
    error: float = 0.0

    @property
    def intrinsics(self) -> tuple[float, float, float, float]:
        return self.fx, self.fy, self.cx, self.cy

    @staticmethod
    def of(camera: Camera) -> CameraParameters:
        """Raises ValueError for a camera of another class."""
        if isinstance(camera, Fisheye):
            return CameraParameters("fisheye", camera.fx, camera.fy, camera.cx, camera.cy, camera.distortion)
        across, middle = camera.width / (2 * np.pi), (camera.width - 1) / 2
        if isinstance(camera, Panorama):
            return CameraParameters("equirectangular", across, camera.height / np.pi, middle, (camera.height - 1) / 2)
        if isinstance(camera, Cylinder):
            return CameraParameters("cylindrical", across, camera.focal, middle, camera.horizon - 0.5)
        K, distortion, error = opencv_intrinsics(camera)
        numbers = (float(K[0, 0]), float(K[1, 1]), float(K[0, 2]), float(K[1, 2]))
        return CameraParameters("pinhole", *numbers, tuple(map(float, distortion)), error)


PANORAMAS = """
A panorama is no pinhole. Its azimuth (anticlockwise from straight ahead) and elevation [rad] follow from fx, fy, cx, cy and the pixel (u, v):
equirectangular: u = cx − fx · azimuth, v = cy − fy · elevation, fx and fy in pixels per radian.
cylindrical: u = cx − fx · azimuth, v = cy − fy · tan(elevation), fx in pixels per radian, fy in pixels.
In the optical frame, azimuth = atan2(−x, z) and elevation = atan2(−y, √(x² + z²)). u counts modulo the width: the seam is behind.
"""
"""For README.md of an export: what the four numbers of a panorama mean."""


@dataclass(frozen=True, eq=False)
class ExportedView:
    """The exported images of a camera of a sequence, unchanged or resampled. T_camera_view: both x forward, y left, z up."""

    source: str
    name: str
    camera: Camera
    T_camera_view: Pose = field(default_factory=Pose.identity)
    resampling: Resampling | None = None

    def image(self, recording: RecordedSequence, frame: int, suffix: str, gray: bool = False) -> bytes:
        """The image as the bytes of a JPEG or PNG file."""
        if self.resampling is None and not gray:
            return recording.image(frame, self.source, suffix)
        pixels: NDArray[np.uint8] = recording.pixels(frame, self.source)
        if gray:
            pixels = np.asarray(cv2.cvtColor(pixels, cv2.COLOR_BGR2GRAY))
        return recording.encoded(pixels if self.resampling is None else self.resampling.image(pixels), suffix)


def faces(name: str, camera: Camera) -> list[ExportedView]:
    """Six faces of a panorama, the four level ones of a cylinder, or any other camera unchanged."""
    if not isinstance(camera, PanoramicCamera):
        return [ExportedView(name, name, camera)]
    target = face_camera(camera)
    level = [face for face in FACES if face not in ("up", "down")]
    chosen = level if isinstance(camera, Cylinder) else list(FACES)
    return [_resampled(name, f"{name}_{face}", camera, target, FACES[face]) for face in chosen]


def straight(name: str, camera: Camera) -> ExportedView:
    """The view of a camera as a pinhole without distortion: the front face of a panorama, else with the camera's focal lengths."""
    if isinstance(camera, PanoramicCamera):
        return faces(name, camera)[0]
    parameters = CameraParameters.of(camera)
    if not any(parameters.distortion) and parameters.model == "pinhole":
        return ExportedView(name, name, camera)
    target = Pinhole(camera.width, camera.height, *parameters.intrinsics)
    return _resampled(name, name, camera, target, np.eye(3))


def _resampled(source: str, name: str, camera: Camera, target: Camera, rotation: Array) -> ExportedView:
    return ExportedView(source, name, target, Pose(rotation, np.zeros(3)), Resampling(camera, target, rotation))


def pixel_errors(cameras: dict[str, Camera]) -> list[str]:
    """Notes for README.md: the errors of cameras whose distortion was fitted."""
    errors = {name: CameraParameters.of(camera).error for name, camera in cameras.items() if isinstance(camera, Tsai) and camera.kappa1}
    return [f"{name}: its distortion is fitted to {error:.2g} px" for name, error in errors.items()]


def camera_notes(recording: RecordedSequence, cameras: Iterable[str], fate: str) -> list[str]:
    """Notes for README.md on cameras without images, which end with `fate`, and on cameras whose distortion is fitted."""
    names = list(cameras)
    without = [name for name in names if not recording.has_images(name)]
    notes = [f"has no images of {', '.join(without)}; {fate}"] if without else []
    return [f"{recording.name}: {note}." for note in notes + pixel_errors({name: recording.cameras[name] for name in names})]


def face_camera(camera: PanoramicCamera) -> Pinhole:
    """The pinhole of a face: 90° in both directions, with the panorama's pixels per radian in its middle (rounded to an even side)."""
    side = max(2 * round(camera.width / (2 * np.pi)), 2)
    return Pinhole(side, side, side / 2, side / 2, (side - 1) / 2, (side - 1) / 2)


@dataclass(frozen=True, eq=False)
class Resampling:
    """Makes the image of `target` from that of `source`, two cameras with one centre. R_source_target (3, 3): target frame to source frame."""

    source: Camera
    target: Camera
    R_source_target: Array

    @cached_property
    def _map(self) -> NDArray[np.float32]:
        """Column and row of the source, its first pixel's centre at (0, 0), for each pixel of the target: (2, H, W).

        In a source that wraps, columns count from the column that `image` adds before the first.
        """
        shift = self.target.pixel_centre
        u, v = np.meshgrid(np.arange(self.target.width) + shift, np.arange(self.target.height) + shift)
        aim = np.column_stack([u.ravel(), v.ravel()])
        pixels, seen = self.source.pixels_from_bearings(self.target.bearings_from_pixels(aim) @ self.R_source_target.T)
        at = np.where((seen & ~self.target.blind(aim))[:, None], pixels - self.source.pixel_centre, FARTHEST_OUT)
        # Within half a pixel of the border the nearest pixel is taken. At a seam, `image` adds the column of the other side.
        low = np.array([-1.0 if self.source.wraps else 0.0, 0.0])
        high = np.array([self.source.width - (0.0 if self.source.wraps else 1.0), self.source.height - 1.0])
        at = np.where(at > FARTHEST_OUT, np.clip(at, low, high), at)
        if self.source.wraps:
            at = at + np.array([1.0, 0.0])
        return np.ascontiguousarray(at.T.reshape(2, self.target.height, self.target.width), dtype=np.float32)

    def image(self, image: NDArray[Any]) -> NDArray[Any]:
        """The source's image (H, W) or (H, W, 3) → the target's, sampled bilinearly; black where the source sees nothing."""
        if self.source.wraps:
            image = np.concatenate([image[:, -1:], image, image[:, :1]], axis=1)
        u, v = self._map
        return np.asarray(cv2.remap(image, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=0))
