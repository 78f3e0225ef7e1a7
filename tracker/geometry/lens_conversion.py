"""Cameras in the parameters of another model: OpenCV's pinhole for any pinhole camera, and Tsai's model for pinholes without distortion."""

from __future__ import annotations

import cv2
import numpy as np

from tracker.geometry.arrays import Array
from tracker.geometry.camera_protocol import OPTICAL_FROM_CAMERA, Camera
from tracker.geometry.lenses import Pinhole
from tracker.geometry.tsai import PIXEL_PITCH, Tsai

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
