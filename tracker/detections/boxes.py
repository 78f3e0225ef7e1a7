"""Conversions between pixel boxes and detections, which are angles."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tracker.geometry import Array, Mask, angles_from_bearing, bearing_from_angles
from tracker.geometry.cameras import Camera, PanoramicCamera, Tsai
from tracker.types import Detections

EDGE_PIXELS = 2.0
"""px, constant part of the standard deviation of a box's edge."""
EDGE_SHARE = 0.02
"""Part of that standard deviation that grows with the box, as a share of its height."""
DISTORTION_SHARE = 1.0
"""Standard deviation of a barrel distortion (κ1 < 0) as a share of its own size: such calibrations are poor (View_007 of PETS 2009, left)."""
HIDDEN_FEET = 0.12
"""Share of the height of a box: a visible part that ends more than this above the lower edge has no feet."""
LEAST_SHARE = 0.3
"""Least visible share of a body whose feet count as seen: below it, most feet are hidden."""
ITERATIONS = 60
"""Fixed-point iterations for the width of a detection; each reduces the error to a few per cent."""


def detections_from_boxes(camera: Camera, boxes: Array, confidence: Array, deviation: Array | None = None) -> Detections:
    """Detections of pixel boxes (n, 4): left, top, width, height; confidence (n,), any finite number.

    deviation (n, 2) px: standard deviations of the middle column and of the lower edge, where the detector knows them.
    The azimuth is that of the middle of the lower edge. The covariance is that of the same point.
    In an image that wraps, left may be anywhere, and left + width may pass the seam.
    """
    if not len(boxes):
        return Detections.none()
    left, top, width, height = boxes.T
    middle, bottom, waist = left + width / 2, top + height, top + height / 2

    def angles(u: Array, v: Array) -> tuple[Array, Array]:
        return angles_from_bearing(camera.bearings_from_pixels(np.stack([u, v], axis=1)))

    azimuth, low = angles(middle, bottom)
    _, high = angles(middle, top)
    span = _turned(camera, angles(left, waist)[0] - angles(left + width, waist)[0])
    usual = EDGE_PIXELS + EDGE_SHARE * height
    across, up = (usual, usual) if deviation is None else deviation.T
    by_side = _turned(camera, angles(middle - across, bottom)[0] - angles(middle + across, bottom)[0]) / 2 * np.cos(low)
    by_height = (angles(middle, bottom - up)[1] - angles(middle, bottom + up)[1]) / 2
    covariance = np.zeros((len(boxes), 2, 2))
    covariance[:, 0, 0], covariance[:, 1, 1] = by_side**2, by_height**2
    if isinstance(camera, Tsai) and camera.kappa1 < 0:
        straight = angles_from_bearing(replace(camera, kappa1=0.0).bearings_from_pixels(np.stack([middle, bottom], axis=1)))
        covariance[:, 0, 0] += (DISTORTION_SHARE * (straight[0] - azimuth) * np.cos(low)) ** 2
        covariance[:, 1, 1] += (DISTORTION_SHARE * (straight[1] - low)) ** 2
    bearing = bearing_from_angles(azimuth, (low + high) / 2)
    extent = np.stack([span, high - low], axis=1)
    return Detections(bearing, extent, confidence, covariance, np.zeros((len(boxes), 0)))


def feet_seen(boxes: Array, visible: Array) -> Mask:
    """Whether the feet of boxes (n, 4) px are in their visible parts (n, 5): left, top, width, height px, and the share of the body."""
    ends_above = boxes[:, 1] + boxes[:, 3] - visible[:, 1] - visible[:, 3]
    return np.asarray((ends_above <= HIDDEN_FEET * boxes[:, 3]) & (visible[:, 4] >= LEAST_SHARE))


def _turned(camera: Camera, turn: Array) -> Array:
    """Angles (n,) rad between left and right edges, from differences in (−2π, 2π): negative ones across the seam get a full turn added."""
    return np.where(turn < 0, turn + 2 * np.pi, turn) if camera.wraps else turn


def approximate_pixel_boxes(camera: Camera, detections: Detections) -> tuple[Array, Array]:
    """Middle (n, 2) px and size (n, 2) px of boxes; the middle is NaN for a box that is not in front of the camera.

    The slant of a box near the edge of a wide image is neglected; `boxes_of_detections` is the exact and slower conversion.
    """
    azimuth, elevation = angles_from_bearing(detections.bearing)
    half = detections.extent / 2

    def pixels(da: Array | float, de: Array | float) -> Array:
        return np.asarray(camera.pixels_from_bearings(bearing_from_angles(azimuth + da, elevation + de))[0])

    middle = pixels(0.0, 0.0)
    across = np.abs(pixels(half[:, 0], 0.0)[:, 0] - pixels(-half[:, 0], 0.0)[:, 0])
    up = np.abs(pixels(0.0, half[:, 1])[:, 1] - pixels(0.0, -half[:, 1])[:, 1])
    if camera.wraps:
        across = np.minimum(across, camera.width - across)
    size = np.stack([across, up], axis=1)
    middle[~((size > 0) & np.isfinite(size)).all(axis=1)] = np.nan
    return middle, size


def boxes_of_detections(camera: Camera, detections: Detections) -> Array:
    """Boxes (n, 4) left, top, width, height px from the corner of the image; the inverse of detections_from_boxes.

    In an image that wraps, left lies in [0, W), and left + width may exceed W. In another image the bearing gives the middle column of the box.
    Its width is the one that spans the detected azimuth at the middle of its height.
    """
    if not len(detections):
        return np.zeros((0, 4))
    azimuth, elevation = angles_from_bearing(detections.bearing)
    span, rise = detections.extent.T
    if isinstance(camera, PanoramicCamera):
        per_radian = camera.width / (2 * np.pi)
        left = np.mod((np.pi - azimuth - span / 2) * per_radian, camera.width)
        top, height = camera.edges_from_spans(elevation, rise)
        return np.column_stack([left, top, span * per_radian, height])
    pixels = [camera.pixels_from_bearings(bearing_from_angles(azimuth, elevation + side * rise / 2))[0] for side in (-1, 1)]
    # Where the distortion has no inverse, the upper edge is outside the image.
    (u, bottom), top = pixels[0].T, np.nan_to_num(pixels[1][:, 1], nan=camera.pixel_centre - 0.5)
    middle = (top + bottom) / 2

    def azimuth_span(width: Array) -> Array:
        left, right = (angles_from_bearing(camera.bearings_from_pixels(np.column_stack([u + s * width / 2, middle])))[0] for s in (-1, 1))
        return np.asarray(left - right)

    width = bottom - top
    for _ in range(ITERATIONS):
        width = width * span / azimuth_span(width)
    return np.column_stack([u - width / 2, top, width, bottom - top]) + np.array([0.5 - camera.pixel_centre] * 2 + [0.0, 0.0])
