"""Intersection over union (IoU) of boxes in an image, given by their edges: left, top, right, bottom px."""

from __future__ import annotations

import numpy as np

from tracker.geometry.arrays import Array


def box_overlaps(a: Array, b: Array, period: float | None = None) -> Array:
    """IoU (n, m) of boxes (n, 4) and (m, 4): left, top, right, bottom px.

    period: width of an image that wraps; each pair is taken where it is nearest.
    """
    shift = None
    if period is not None:
        apart = (b[None, :, 0] + b[None, :, 2] - a[:, None, 0] - a[:, None, 2]) / 2
        shift = period * np.round(apart / period)
    return _iou(a[:, None], b[None], shift)


def paired_overlaps(a: Array, b: Array) -> Array:
    """IoU (n,) of each two boxes (n, 4) of the same row."""
    return _iou(a, b, None)


def _iou(a: Array, b: Array, shift: Array | None) -> Array:
    """IoU of boxes whose shapes are broadcast; b is moved to the left by `shift` px."""
    left, right = (b[..., 0], b[..., 2]) if shift is None else (b[..., 0] - shift, b[..., 2] - shift)
    across = np.minimum(a[..., 2], right) - np.maximum(a[..., 0], left)
    along = np.minimum(a[..., 3], b[..., 3]) - np.maximum(a[..., 1], b[..., 1])
    common = np.maximum(across, 0.0) * np.maximum(along, 0.0)
    areas = [np.maximum(box[..., 2] - box[..., 0], 0.0) * np.maximum(box[..., 3] - box[..., 1], 0.0) for box in (a, b)]
    return np.asarray(common / np.maximum(areas[0] + areas[1] - common, 1e-9))
