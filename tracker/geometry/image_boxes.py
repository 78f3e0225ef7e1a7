"""Boxes in an image: intersection over union (IoU), boxes of upright bodies, and the parts of boxes in the image.

A box is given by its edges: left, top, right, bottom px. Bodies are cylinders at given places.
"""

from __future__ import annotations

import numpy as np

from tracker.geometry.arrays import Array, Ints
from tracker.geometry.camera_protocol import Camera
from tracker.geometry.poses import Pose


def box_overlaps(a: Array, b: Array, period: float | None = None) -> Array:
    """IoU (n, m) of boxes (n, 4) and (m, 4): left, top, right, bottom px.

    period: width px of an image that wraps; each pair is compared at the turn at which the boxes are nearest.
    """
    shift = None
    if period is not None:
        apart = (b[None, :, 0] + b[None, :, 2] - a[:, None, 0] - a[:, None, 2]) / 2
        shift = period * np.round(apart / period)
    return _iou(a[:, None], b[None], shift)


def paired_overlaps(a: Array, b: Array) -> Array:
    """IoU (n,) of boxes a (n, 4) and b (n, 4), row by row."""
    return _iou(a, b, None)


def _iou(a: Array, b: Array, shift: Array | None) -> Array:
    """IoU of boxes whose shapes are broadcast; b is moved to the left by `shift` px."""
    left, right = (b[..., 0], b[..., 2]) if shift is None else (b[..., 0] - shift, b[..., 2] - shift)
    across = np.minimum(a[..., 2], right) - np.maximum(a[..., 0], left)
    along = np.minimum(a[..., 3], b[..., 3]) - np.maximum(a[..., 1], b[..., 1])
    common = np.maximum(across, 0.0) * np.maximum(along, 0.0)
    areas = [np.maximum(box[..., 2] - box[..., 0], 0.0) * np.maximum(box[..., 3] - box[..., 1], 0.0) for box in (a, b)]
    return np.asarray(common / np.maximum(areas[0] + areas[1] - common, 1e-9))


CORNERS = 16
"""Points around each end of the cylinder that models a body."""
LEAST_VISIBLE = 0.25
"""Bodies of which a smaller share of the box lies in the image have no box."""


def body_boxes(camera: Camera, T_world_camera: Pose, feet: Array, body: tuple[float, float] = (1.75, 0.5)) -> Array:
    """Boxes (m, 4) left, top, width, height px of the bodies in the image, out of bodies at feet (k, 3) m, world.

    body: height and width, m, of an upright cylinder. Bodies with a point that the camera cannot project (behind it, or beyond the fold) have no box.
    Boxes of panoramas have left in [0, W), and left + width may exceed W.
    """
    _, low, high = body_outlines(camera, T_world_camera, feet, body)
    seen = clipped(low, high, camera)
    size, whole = seen[:, 2:] - seen[:, :2], high - low
    shown = np.prod(size, axis=1) > LEAST_VISIBLE * np.prod(whole, axis=1)
    return boxes_from_edges(camera, seen[shown])


def body_outlines(camera: Camera, T_world_camera: Pose, feet: Array, body: tuple[float | Array, float] = (1.75, 0.5)) -> tuple[Ints, Array, Array]:
    """Bounding boxes of bodies, not clipped to the image: rows (m,) of `feet`, and lowest and highest corner (m, 2) px of each.

    feet (k, 3) m, world. body: height, of all or (k,), and width, m, of upright cylinders.
    Bodies with a point that the camera cannot project are left out.
    Columns in panoramas are not wrapped into [0, W).
    """
    height, width = body
    around = np.linspace(0, 2 * np.pi, CORNERS, endpoint=False)
    ring = width / 2 * np.column_stack([np.cos(around), np.sin(around), np.zeros(CORNERS)])
    # The last point, in the middle, tells on which side of the seam of a panorama the body is.
    level = np.concatenate([ring, ring, np.zeros((1, 3))])
    up = np.concatenate([np.zeros(CORNERS), np.ones(CORNERS), [0.5]])[:, None] * np.array([0.0, 0.0, 1.0])
    cylinders = level + np.reshape(height, (-1, 1, 1)) * up
    points = (np.asarray(feet, dtype=np.float64).reshape(-1, 1, 3) + cylinders).reshape(-1, 3)
    rays = T_world_camera.inverse().apply(points)
    rays /= np.maximum(np.linalg.norm(rays, axis=1, keepdims=True), 1e-9)
    pixels = camera.pixels_from_bearings(rays)[0].reshape(-1, len(level), 2)
    rows = np.flatnonzero(np.isfinite(pixels).all(axis=(1, 2)))
    pixels = pixels[rows]
    if camera.wraps:
        apart = pixels[:, :, 0] - pixels[:, -1:, 0]
        pixels[:, :, 0] = pixels[:, -1:, 0] + np.mod(apart + camera.width / 2, camera.width) - camera.width / 2
    return rows, pixels[:, :-1].min(axis=1), pixels[:, :-1].max(axis=1)


def clipped(low: Array, high: Array, camera: Camera) -> Array:
    """Corners low and high (n, 2) px → edges left, top, right, bottom (n, 4) px of the part in the image. In panoramas only rows are clipped."""
    first = camera.pixel_centre - 0.5
    least, most = np.array([first, first]), np.array([first + camera.width, first + camera.height])
    if camera.wraps:
        least[0], most[0] = -np.inf, np.inf
    return np.concatenate([np.clip(low, least, most), np.clip(high, least, most)], axis=1)


def edges_of(boxes: Array) -> Array:
    """Edges left, top, right, bottom px (n, 4) of boxes left, top, width, height px, the first four columns of `boxes`."""
    return np.hstack([boxes[:, :2], boxes[:, :2] + boxes[:, 2:4]])


def boxes_from_edges(camera: Camera, edges: Array) -> Array:
    """Edges left, top, right, bottom px (n, 4) → left, top, width, height px; in panoramas left is in [0, W)."""
    left = np.mod(edges[:, 0], camera.width) if camera.wraps else edges[:, 0]
    return np.column_stack([left, edges[:, 1], edges[:, 2:] - edges[:, :2]])
