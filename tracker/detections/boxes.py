"""Boxes in pixels as what detections are, angles, and detections as boxes in pixels where these need not be exact."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tracker.geometry import Array, angles_from_bearing, bearing_from_angles
from tracker.geometry.cameras import Camera, Panorama, Tsai
from tracker.types import Detections

FOOT_PIXELS = 2.0  # px, error of a box's edge ...
FOOT_SHARE = 0.02  # ... and as a share of its height
DISTORTION_SHARE = 1.0  # where a distortion folds back (κ1 < 0) the calibration is off by about as much as it bends: View_007, left


def detections_from_boxes(camera: Camera, boxes: Array, confidence: Array) -> Detections:
    """Pixel boxes (n, 4) left, top, width, height → Detections; the azimuth is that of the middle of the lower edge."""
    if not len(boxes):
        return Detections.none()
    left, top, width, height = boxes.T
    middle, bottom, waist = left + width / 2, top + height, top + height / 2

    def angles(u: Array, v: Array) -> tuple[Array, Array]:
        return angles_from_bearing(camera.bearings_from_pixels(np.stack([u, v], axis=1)))

    azimuth, low = angles(middle, bottom)
    _, high = angles(middle, top)
    span = angles(left, waist)[0] - angles(left + width, waist)[0]
    sigma = FOOT_PIXELS + FOOT_SHARE * height
    by_side = (angles(middle - sigma, bottom)[0] - angles(middle + sigma, bottom)[0]) / 2 * np.cos(low)
    by_height = (angles(middle, bottom - sigma)[1] - angles(middle, bottom + sigma)[1]) / 2
    covariance = np.zeros((len(boxes), 2, 2))
    covariance[:, 0, 0], covariance[:, 1, 1] = by_side**2, by_height**2
    if isinstance(camera, Tsai) and camera.kappa1 < 0:
        straight = angles_from_bearing(replace(camera, kappa1=0.0).bearings_from_pixels(np.stack([middle, bottom], axis=1)))
        covariance[:, 0, 0] += (DISTORTION_SHARE * (straight[0] - azimuth) * np.cos(low)) ** 2
        covariance[:, 1, 1] += (DISTORTION_SHARE * (straight[1] - low)) ** 2
    bearing = bearing_from_angles(azimuth, (low + high) / 2)
    extent = np.stack([span, high - low], axis=1)
    return Detections(bearing, extent, np.clip(confidence, 0.0, 1.0), covariance, np.zeros((len(boxes), 0)))


def drawn(camera: Camera, detections: Detections) -> tuple[Array, Array]:
    """Middle (n, 2) px and size (n, 2) px of boxes, NaN for those that cannot be drawn; beside footage.boxes_of_detections this is quick, and right
    but for the slant of a box at the edge of a wide image.
    """
    azimuth, elevation = angles_from_bearing(detections.bearing)
    half = detections.extent / 2

    def pixels(da: Array | float, de: Array | float) -> Array:
        return np.asarray(camera.pixels_from_bearings(bearing_from_angles(azimuth + da, elevation + de))[0])

    middle = pixels(0.0, 0.0)
    across = np.abs(pixels(half[:, 0], 0.0)[:, 0] - pixels(-half[:, 0], 0.0)[:, 0])
    up = np.abs(pixels(0.0, half[:, 1])[:, 1] - pixels(0.0, -half[:, 1])[:, 1])
    if isinstance(camera, Panorama):
        across = np.minimum(across, camera.width - across)
    size = np.stack([across, up], axis=1)
    middle[~((size > 0) & np.isfinite(size)).all(axis=1)] = np.nan
    return middle, size
