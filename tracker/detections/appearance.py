"""What people look like: histograms of the hue, saturation and brightness of the upper and of the lower body (C_app of Yoo et al. 2017 has
three of 16 bins for all of it)."""

from __future__ import annotations

import cv2
import numpy as np

from tracker.detections.boxes import drawn
from tracker.geometry import Array, Image, Mask
from tracker.geometry.cameras import Camera
from tracker.types import Detections

BINS = 16
PARTS = ((0.15, 0.5), (0.5, 0.9))
"""Shares of a box's height between which the upper and the lower body lie."""
SIZE = BINS * 3 * len(PARTS)
"""Numbers of a look."""
MIDDLE = 0.2
"""Of a box's width: pixels count less the farther they are from its middle (standard deviation)."""
LEAST = 0.2
"""Share of what a part would count if nothing hid it, from which it says something."""
SMALLEST = 4, 8
"""px, width and height of a box from which it has a look."""


def appearances(image: Image, camera: Camera, detections: Detections, foreground: Mask | None = None) -> Array:
    """Looks (n, SIZE) of boxes, vectors of length 1 whose product is 1 for those who look alike (square roots of histograms: Bhattacharyya's
    coefficient); NaN where too little of somebody is to be seen. foreground (h, w) of any size: which pixels are of people, None where that is
    not known.

    Pixels under a nearer box (one that ends lower) are left out.
    """
    height, width = image.shape[:2]
    middle, size = drawn(camera, detections)
    scale = np.array([width / camera.width, height / camera.height])
    middle, size = (middle + 0.5 - camera.pixel_centre) * scale, size * scale
    boxes = np.column_stack([middle - size / 2, middle + size / 2])
    colours = np.asarray(cv2.cvtColor(image, cv2.COLOR_RGB2HSV), dtype=np.uint8) // (256 // BINS)
    people: Image = np.ones((height, width), dtype=np.uint8)
    if foreground is not None:
        people = np.asarray(cv2.resize(foreground.astype(np.uint8), (width, height), interpolation=cv2.INTER_NEAREST), dtype=np.uint8)
    return np.array([_look(colours, people, boxes, k) for k in range(len(boxes))]).reshape(-1, SIZE)


def _look(colours: Image, people: Image, boxes: Array, k: int) -> Array:
    """(SIZE,) of the box in row k of left, top, right, bottom px; columns beyond an edge are those of the other side, as of a panorama."""
    nothing = np.full(SIZE, np.nan)
    if not np.isfinite(boxes[k]).all():
        return nothing
    left, top, right, bottom = boxes[k]
    columns = np.arange(round(left), round(right))
    rows = np.arange(max(round(top), 0), min(round(bottom), len(colours)))
    if len(columns) < SMALLEST[0] or len(rows) < SMALLEST[1]:
        return nothing
    across = np.exp(-0.5 * ((columns + 0.5 - (left + right) / 2) / (MIDDLE * (right - left))) ** 2)
    patch = np.ix_(rows, columns % colours.shape[1])
    weight = people[patch] * across
    for other in boxes[boxes[:, 3] > bottom + 1]:
        over = (rows[:, None] >= other[1]) & (rows[:, None] < other[3]) & (columns >= other[0]) & (columns < other[2])
        weight = np.where(over, 0.0, weight)
    out, level = [], colours[patch]
    for low, high in PARTS:
        part = (rows + 0.5 > top + low * (bottom - top)) & (rows + 0.5 < top + high * (bottom - top))
        counted = weight[part]
        if not counted.size or counted.sum() < LEAST * across.sum() * (high - low) * (bottom - top):
            return nothing
        for channel in range(3):
            histogram = np.bincount(level[part][..., channel].ravel(), weights=counted.ravel(), minlength=BINS)
            out.append(np.convolve(histogram, [0.25, 0.5, 0.25], mode="same") / counted.sum())
    look = np.sqrt(np.concatenate(out))
    return look / np.linalg.norm(look)
