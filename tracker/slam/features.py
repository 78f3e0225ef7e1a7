"""SIFT features of a panorama (Lowe 2004), by OpenCV.

A tilted panorama is levelled first: SIFT is repeatable under yaw, but not under 10° of roll and pitch. It is padded by wrap-around at the
seam, and cropped towards the poles, where the projection stretches.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from tracker.geometry import Array, Floats, Image, Mask, angles_from_bearing, exp_so3
from tracker.geometry.cameras import Panorama
from tracker.types import Detections, Sightings


@dataclass(frozen=True)
class FeatureParameters:
    """Parameters of feature extraction.

    limit: features of an image. elevation rad: the band about the horizon of the level image. level_tolerance rad: a smaller tilt is not
    levelled. contrast: OpenCV's contrastThreshold. columns, rows: cells over which the features are distributed. sigma rad per axis: the error
    of a correct match of a patch of reference_size rad. It is in proportion to the patch's diameter, within sigma_range rad. enlarge: factor
    of the boxes of people. pad: pixels of wrap-around. max_size rad: wider patches lie on more than one object.
    """

    limit: int = 300
    elevation: float = 0.96
    level_tolerance: float = 0.017
    contrast: float = 0.03
    columns: int = 16
    rows: int = 5
    sigma: float = 0.004
    reference_size: float = 0.05
    sigma_range: tuple[float, float] = (0.0016, 0.008)
    enlarge: float = 1.2
    pad: int = 48
    max_size: float = 0.1

    def bearing_sigma(self, size: Array) -> Array:
        """(n,) rad: the standard deviation per axis of bearings of patches with diameters size (n,) rad.

        A wide patch shows more than one surface, and slides farther over them as the view changes.
        """
        return np.clip(self.sigma * size / self.reference_size, *self.sigma_range)


@dataclass(frozen=True, eq=False)
class Features:
    """Features of one image.

    bearing (n, 3) unit, camera frame. descriptor (n, 128) float32, RootSIFT of length 1. size (n,) rad, the diameter of the patch.
    response (n,), the local contrast. sigma (n,) rad: the standard deviation of a bearing per axis.
    """

    bearing: Array
    descriptor: Floats
    size: Array
    response: Array
    sigma: Array

    def __len__(self) -> int:
        return len(self.bearing)

    def select(self, chosen: Mask) -> Features:
        """The features of a mask (n,)."""
        return Features(*(getattr(self, field.name)[chosen] for field in fields(self)))

    def sightings(self) -> Sightings:
        """The features as sightings of unidentified landmarks."""
        n = len(self)
        covariance = np.square(self.sigma)[:, None, None] * np.eye(2)
        return Sightings(self.bearing, np.full(n, np.nan), np.full(n, -1), self.descriptor, covariance)


def extract(image: Image, camera: Panorama, up: Array, people: Detections, parameters: FeatureParameters) -> Features:
    """Features of an image (H, W, 3) uint8 RGB, distributed over it and outside the boxes of people.

    up (3,): the estimated unit "up" in the camera's frame. Raises ValueError if the image is not of the camera's size.
    """
    if image.shape != (camera.height, camera.width, 3):
        raise ValueError(f"image has shape {image.shape}, needs {(camera.height, camera.width, 3)}")
    R_camera_level = leveling_rotation(up, parameters.level_tolerance)
    top, grey = _band(image, R_camera_level, camera, parameters)
    sift: Any = cv2.SIFT_create(contrastThreshold=parameters.contrast, enable_precise_upscale=True)  # type: ignore[attr-defined]
    keypoints = [
        k for k in _detect(sift, grey, parameters.max_size / np.pi * camera.height) if parameters.pad <= k.pt[0] + 0.5 < parameters.pad + camera.width
    ]
    pixel = np.array([k.pt for k in keypoints]).reshape(-1, 2) + np.array([0.5 - parameters.pad, 0.5 + top])
    response = np.array([k.response for k in keypoints])
    bearing = camera.bearings_from_pixels(pixel) @ R_camera_level.T
    chosen = np.flatnonzero(~inside_boxes(bearing, people, parameters.enlarge))
    chosen = chosen[_select_evenly(pixel[chosen], response[chosen], camera, parameters)]
    keypoints = [keypoints[i] for i in chosen]
    keypoints, descriptor = sift.compute(grey, keypoints) if keypoints else ([], np.zeros((0, 128)))
    size = np.array([k.size for k in keypoints]) * np.pi / camera.height
    return Features(bearing[chosen], root_sift(descriptor), size, response[chosen], parameters.bearing_sigma(size))


def _detect(sift: Any, grey: Image, widest: float) -> list[Any]:
    """Keypoints with a diameter of at most `widest` pixels, from the image's own resolution upwards.

    OpenCV doubles its input, and that octave takes four fifths of the time, so it gets the half-size image. On noise textures this takes
    a quarter of the time, with the same share of correct matches and the same error (0.02 to 0.03° per axis).
    """
    found = sift.detect(cv2.resize(grey, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA), None)
    # The image is level, so every patch gets the orientation "up", which is more distinctive than its own. Duplicates are dropped.
    keypoints = list({(k.pt, k.size): k for k in found if 2 * k.size <= widest}.values())
    for k in keypoints:
        k.pt = (2 * k.pt[0] + 0.5, 2 * k.pt[1] + 0.5)
        k.size *= 2
        k.octave = (k.octave & ~255) | ((k.octave + 1) & 255)
        k.angle = 0.0
    return keypoints


def leveling_rotation(up: Array, least: float) -> Array:
    """R_camera_level (3, 3): the smallest rotation that brings the panorama's +z to `up` (3,); the identity for a tilt below `least` rad.

    Raises ValueError for a camera that is upside down, for which no smallest rotation exists.
    """
    axis = np.array([-up[1], up[0], 0.0])
    sine = float(np.linalg.norm(axis))
    tilt = float(np.arctan2(sine, up[2]))
    if tilt > 3.0:
        raise ValueError(f"camera is tilted by {tilt:.3g} rad, needs at most 3")
    return np.eye(3) if tilt < max(least, 1e-12) else exp_so3(axis / sine * tilt)


def _band(image: Image, R_camera_level: Array, camera: Panorama, parameters: FeatureParameters) -> tuple[int, Image]:
    """The first row and the grey pixels of the level panorama within ± the elevation, padded left and right by wrap-around."""
    grey = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
    half = int(np.ceil(parameters.elevation / np.pi * camera.height))
    top, bottom = camera.height // 2 - half, camera.height // 2 + half
    if not np.array_equal(R_camera_level, np.eye(3)):
        grey = cv2.copyMakeBorder(grey, 0, 0, 1, 1, cv2.BORDER_WRAP)
        grey = cv2.remap(grey, *_remap_source(R_camera_level, camera, top, bottom), cv2.INTER_LINEAR)
    else:
        grey = grey[top:bottom]
    return top, np.asarray(cv2.copyMakeBorder(grey, 0, 0, parameters.pad, parameters.pad, cv2.BORDER_WRAP), dtype=np.uint8)


def _remap_source(R_camera_level: Array, camera: Panorama, top: int, bottom: int) -> tuple[Floats, Floats]:
    """Where each pixel of the level band lies in the image padded by one column.

    Returns float32 columns and rows, with pixel centres at whole numbers.
    """
    azimuth = (np.pi - 2 * np.pi * (np.arange(camera.width) + 0.5) / camera.width).astype(np.float32)
    elevation = (np.pi / 2 - np.pi * (np.arange(top, bottom) + 0.5) / camera.height).astype(np.float32)[:, None]
    R = R_camera_level.astype(np.float32)
    x, y, z = np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)
    a, b, c = (R[i, 0] * x + R[i, 1] * y + R[i, 2] * z for i in range(3))
    column = (np.pi - np.arctan2(b, a)) * np.float32(camera.width / (2 * np.pi)) + np.float32(0.5)
    row = (np.pi / 2 - np.arcsin(np.clip(c, -1, 1))) * np.float32(camera.height / np.pi) - np.float32(0.5)
    return column, row


def inside_boxes(bearing: Array, boxes: Detections, enlarge: float) -> Mask:
    """Whether directions (n, 3) lie in any of the boxes, enlarged by a factor: (n,)."""
    inside = np.zeros(len(bearing), dtype=bool)
    if len(boxes) and len(bearing):
        azimuth, elevation = angles_from_bearing(bearing)
        centre, middle = angles_from_bearing(boxes.bearing)
        across = np.abs(np.mod(azimuth[:, None] - centre + np.pi, 2 * np.pi) - np.pi)
        above = np.abs(elevation[:, None] - middle)
        inside |= ((across <= enlarge * boxes.extent[:, 0] / 2) & (above <= enlarge * boxes.extent[:, 1] / 2)).any(axis=1)
    return inside


def _select_evenly(pixel: Array, response: Array, camera: Panorama, parameters: FeatureParameters) -> NDArray[np.intp]:
    """At most `limit` of the keypoints (n, 2): the strongest of every cell, then the second of every cell, and so on."""
    band = 2 * parameters.elevation / np.pi * camera.height
    column = np.floor(pixel[:, 0] / camera.width * parameters.columns).astype(int).clip(0, parameters.columns - 1)
    row = np.floor(((pixel[:, 1] - camera.height / 2) / band + 0.5) * parameters.rows).astype(int).clip(0, parameters.rows - 1)
    cell = row * parameters.columns + column
    order = np.lexsort((pixel[:, 1], pixel[:, 0], -response, cell))
    first = np.searchsorted(cell[order], cell[order])
    rank = np.arange(len(order)) - first
    return order[np.lexsort((-response[order], rank))[: parameters.limit]]


def root_sift(descriptor: NDArray[np.floating]) -> Floats:
    """SIFT's histograms (n, 128) → RootSIFT of length 1 (Arandjelović & Zisserman 2012): its Euclidean distance is Hellinger's."""
    d = np.asarray(descriptor, dtype=np.float32)
    out: Floats = np.sqrt(d / np.maximum(d.sum(axis=1, keepdims=True), 1e-12))
    return out
