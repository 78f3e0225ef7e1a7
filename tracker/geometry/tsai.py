"""Tsai's pinhole camera with one radial term, in the parameters of the PETS 2009 files, and its conversion from and to OpenCV's pinhole.

Pixel centres lie at whole numbers, as those files define.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import ArrayLike

from tracker.geometry.arrays import Array, Mask
from tracker.geometry.camera_protocol import OPTICAL_FROM_CAMERA, Camera, check_size
from tracker.geometry.lenses import Pinhole

PIXEL_PITCH = 5e-3
"""mm: pixel size of simulated pinhole cameras. Only its ratio to the focal length matters."""
NEWTON_STEPS = 30
"""Greatest number of steps in which a distortion is inverted."""


@dataclass(frozen=True)
class Tsai:
    """Tsai's pinhole with one radial term (Tsai 1987), in the parameters of the PETS 2009 files.

    focal mm. kappa1 1/mm²: undistorted = distorted · (1 + κ1 r²). dpx, dpy mm per pixel. cx, cy pixels. sx: horizontal scale factor.
    With κ1 < 0 the model folds back at r = 1/√(−3 κ1). A pixel beyond that radius shares its direction with a pixel within.
    `pixels_from_bearings` returns the pixel within. In PETS 2009 only the left corners of View_007 lie beyond.
    Raises ValueError for numbers that are not finite or not above 0.
    """

    width: int
    height: int
    focal: float
    kappa1: float
    cx: float
    cy: float
    sx: float
    dpx: float
    dpy: float

    def __post_init__(self) -> None:
        check_size(self.width, self.height)
        for name in ("kappa1", "cx", "cy"):
            if not np.isfinite(getattr(self, name)):
                raise ValueError(f"{name} is {getattr(self, name)}, needs a finite number")
        for name in ("focal", "sx", "dpx", "dpy"):
            if not 0 < getattr(self, name) < np.inf:
                raise ValueError(f"{name} is {getattr(self, name)}, needs more than 0")

    @property
    def pixel_centre(self) -> float:
        return 0.0

    @property
    def wraps(self) -> bool:
        return False

    @property
    def fold(self) -> float:
        """Radius on the sensor, mm, beyond which the distortion has no inverse; inf for κ1 ≥ 0."""
        return float(np.sqrt(-1 / (3 * self.kappa1))) if self.kappa1 < 0 else np.inf

    def folded(self, pixels: ArrayLike) -> Mask:
        """(n, 2) pixels → (n,) whether each lies beyond the fold radius."""
        return np.asarray(np.hypot(*self._on_sensor(pixels).T) > self.fold)

    def blind(self, pixels: ArrayLike) -> Mask:
        return self.folded(pixels)

    def _on_sensor(self, pixels: ArrayLike) -> Array:
        """(n, 2) pixels → (n, 2) mm from the optical axis, distorted."""
        p = np.asarray(pixels, dtype=np.float64)
        return np.stack([(p[:, 0] - self.cx) * self.dpx / self.sx, (p[:, 1] - self.cy) * self.dpy], axis=1)

    def bearings_from_pixels(self, pixels: ArrayLike) -> Array:
        distorted = self._on_sensor(pixels)
        undistorted = distorted * (1 + self.kappa1 * (distorted**2).sum(axis=1, keepdims=True))
        optical = np.concatenate([undistorted, np.full((len(distorted), 1), self.focal)], axis=1)
        optical /= np.linalg.norm(optical, axis=1, keepdims=True)
        return optical @ OPTICAL_FROM_CAMERA

    def pixels_from_bearings(self, bearings: ArrayLike) -> tuple[Array, Mask]:
        optical = np.asarray(bearings, dtype=np.float64) @ OPTICAL_FROM_CAMERA.T
        ahead = optical[:, 2] > 1e-9
        z = np.where(ahead, optical[:, 2], 1.0)
        undistorted = self.focal * optical[:, :2] / z[:, None]
        distorted, solved = self._distort(undistorted)
        u = distorted[:, 0] * self.sx / self.dpx + self.cx
        v = distorted[:, 1] / self.dpy + self.cy
        inside = ahead & solved & (u >= 0) & (u <= self.width) & (v >= 0) & (v <= self.height)
        pixels = np.stack([u, v], axis=1)
        pixels[~(ahead & solved)] = np.nan
        return pixels, inside

    def _distort(self, undistorted: Array) -> tuple[Array, Mask]:
        """Solve r (1 + κ1 r²) = ru for the smallest root r by Newton's method. A negative κ1 may leave no root."""
        ru = np.linalg.norm(undistorted, axis=1)
        r = ru.copy()
        limit = self.fold
        r = np.minimum(r, 0.99 * limit)
        for _ in range(NEWTON_STEPS // 2):
            before = r
            # Rounding may leave two values that follow each other, so that the end shows after two steps.
            for _ in range(2):
                r = r - (r * (1 + self.kappa1 * r**2) - ru) / np.maximum(1 + 3 * self.kappa1 * r**2, 1e-6)
                r = np.clip(r, 0.0, limit)
            if (r == before).all():
                break
        solved = np.abs(r * (1 + self.kappa1 * r**2) - ru) < 1e-9 * (1 + ru)
        scale = np.where(ru > 1e-12, r / np.where(ru > 1e-12, ru, 1.0), 1.0)
        return undistorted * scale[:, None], solved


def pinhole(width: int, height: int, field: float) -> Tsai:
    """A Tsai camera without distortion (κ1 = 0, sx = 1, square pixels of 5 µm) that spans `field` rad horizontally.

    Its axis goes through the middle of the image. Raises ValueError for a field of view that is not within (0, π).
    """
    if not 0 < field < np.pi:
        raise ValueError(f"field of view is {field} rad, needs more than 0 and less than π")
    focal = width / 2 / np.tan(field / 2) * PIXEL_PITCH
    return Tsai(width, height, float(focal), 0.0, (width - 1) / 2, (height - 1) / 2, 1.0, PIXEL_PITCH, PIXEL_PITCH)


SAMPLES = 40
"""Points along each side of the image at which a distortion is fitted."""


def opencv_intrinsics(camera: Camera) -> tuple[Array, Array, float]:
    """The camera matrix (3, 3) px and the distortion (5,) k1, k2, p1, p2, k3 of OpenCV, and their largest error over the image, px.

    They are exact for a Pinhole. For a Tsai camera they are the best approximation, since the distortion of OpenCV is the inverse of Tsai's.
    Least squares fit k1, k2, k3 of distorted = undistorted (1 + k1 r² + k2 r⁴ + k3 r⁶) to undistorted = distorted (1 + κ1 r²).
    Raises ValueError for another model.
    """
    if isinstance(camera, Pinhole):
        return camera.matrix, np.array(camera.distortion), 0.0
    if not isinstance(camera, Tsai):
        raise ValueError(f"camera is a {type(camera).__name__}, needs a pinhole (Pinhole or Tsai)")
    fx, fy = camera.focal * camera.sx / camera.dpx, camera.focal / camera.dpy
    matrix = np.array([[fx, 0.0, camera.cx], [0.0, fy, camera.cy], [0.0, 0.0, 1.0]])
    u, v = np.meshgrid(np.linspace(0, camera.width - 1, SAMPLES), np.linspace(0, camera.height - 1, SAMPLES))
    pixels = np.column_stack([u.ravel(), v.ravel()])
    optical = camera.bearings_from_pixels(pixels) @ OPTICAL_FROM_CAMERA.T
    straight = optical[:, :2] / optical[:, 2:]
    bent = (pixels - [camera.cx, camera.cy]) / [fx, fy]
    square = (straight**2).sum(axis=1)
    distortion = np.zeros(5)
    if camera.kappa1:
        columns = np.concatenate([straight[:, [axis]] * np.stack([square, square**2, square**3], axis=1) for axis in (0, 1)])
        distortion[[0, 1, 4]] = np.linalg.lstsq(columns, (bent - straight).T.ravel(), rcond=None)[0]
    again = cv2.projectPoints(optical, np.zeros(3), np.zeros(3), matrix, distortion)[0].reshape(-1, 2)
    return matrix, distortion, float(np.linalg.norm(again - pixels, axis=1).max())


def tsai_of(camera: Camera) -> Tsai:
    """The same camera in Tsai's parameters. Raises ValueError for a distortion of OpenCV and for a camera that is no pinhole."""
    if isinstance(camera, Tsai):
        return camera
    if not isinstance(camera, Pinhole) or any(camera.distortion):
        raise ValueError(f"camera is {camera}, needs Tsai's model or a pinhole without distortion")
    c = camera
    return Tsai(c.width, c.height, c.fy * PIXEL_PITCH, 0.0, c.cx, c.cy, c.fx / c.fy, PIXEL_PITCH, PIXEL_PITCH)
