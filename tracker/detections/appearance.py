"""Appearance of people in images: colour histograms of the upper and of the lower body.

Yoo et al. 2017 (C_app) use three histograms of 16 bins for the whole body. Here each half has its own, of hue, saturation and brightness.
"""

from __future__ import annotations

import cv2
import numpy as np

from tracker.detections.boxes import approximate_pixel_boxes
from tracker.geometry import Array, Image, Mask
from tracker.geometry.cameras import Camera
from tracker.types import Detections

BINS = 16
PARTS = ((0.15, 0.5), (0.5, 0.9))
"""Shares of a box's height between which the upper and the lower body lie, from its upper edge."""
SIZE = BINS * 3 * len(PARTS)
"""Length of an appearance vector."""
COLUMN_SIGMA = 0.2
"""Standard deviation, as a share of a box's width, of the weight of a pixel by its distance from the box's middle."""
MIN_VISIBLE = 0.2
"""Least weight of the visible pixels of a part, as a share of the weight of the whole part."""
MIN_PIXELS = 4, 8
"""px, least width and height of a box that has an appearance."""


def appearances(image: Image, camera: Camera, detections: Detections, foreground: Mask | None = None) -> Array:
    """Appearance vectors (n, SIZE) of boxes, of length 1; NaN where too little of a person is visible.

    They are square roots of histograms, so that the product of two is the Bhattacharyya coefficient: 1 for equal histograms.
    foreground (h, w) of any size: pixels that show people, None where that is unknown. Pixels under a nearer box, which ends lower, are left out.
    """
    height, width = image.shape[:2]
    middle, size = approximate_pixel_boxes(camera, detections)
    scale = np.array([width / camera.width, height / camera.height])
    middle, size = (middle + 0.5 - camera.pixel_centre) * scale, size * scale
    boxes = np.column_stack([middle - size / 2, middle + size / 2])
    colours = np.asarray(cv2.cvtColor(image, cv2.COLOR_RGB2HSV), dtype=np.uint8) // (256 // BINS)
    people: Image = np.ones((height, width), dtype=np.uint8)
    if foreground is not None:
        people = np.asarray(cv2.resize(foreground.astype(np.uint8), (width, height), interpolation=cv2.INTER_NEAREST), dtype=np.uint8)
    return np.array([_appearance(colours, people, boxes, k) for k in range(len(boxes))]).reshape(-1, SIZE)


def _appearance(colours: Image, people: Image, boxes: Array, k: int) -> Array:
    """Appearance vector (SIZE,) of the box in row k of `boxes` (n, 4): left, top, right, bottom px.

    Columns beyond an edge of the image are those of the other side, as in a panorama.
    """
    unknown = np.full(SIZE, np.nan)
    if not np.isfinite(boxes[k]).all():
        return unknown
    left, top, right, bottom = boxes[k]
    columns = np.arange(round(left), round(right))
    rows = np.arange(max(round(top), 0), min(round(bottom), len(colours)))
    if len(columns) < MIN_PIXELS[0] or len(rows) < MIN_PIXELS[1]:
        return unknown
    across = np.exp(-0.5 * ((columns + 0.5 - (left + right) / 2) / (COLUMN_SIGMA * (right - left))) ** 2)
    patch = np.ix_(rows, columns % colours.shape[1])
    weight = people[patch] * across
    for other in boxes[boxes[:, 3] > bottom + 1]:
        occluded = (rows[:, None] >= other[1]) & (rows[:, None] < other[3]) & (columns >= other[0]) & (columns < other[2])
        weight = np.where(occluded, 0.0, weight)
    histograms, level = [], colours[patch]
    for low, high in PARTS:
        part = (rows + 0.5 > top + low * (bottom - top)) & (rows + 0.5 < top + high * (bottom - top))
        counted = weight[part]
        if not counted.size or counted.sum() < MIN_VISIBLE * across.sum() * (high - low) * (bottom - top):
            return unknown
        for channel in range(3):
            histogram = np.bincount(level[part][..., channel].ravel(), weights=counted.ravel(), minlength=BINS)
            histograms.append(np.convolve(histogram, [0.25, 0.5, 0.25], mode="same") / counted.sum())
    vector = np.sqrt(np.concatenate(histograms))
    return vector / np.linalg.norm(vector)
