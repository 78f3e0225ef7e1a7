"""Boxes in an image from the outputs of the network, at full size and at half size for large bodies."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from sim.training.targets import STRIDE
from tracker.geometry import Array
from tracker.metrics.box_detection import box_overlaps

Network = Callable[[NDArray[np.uint8]], tuple[NDArray[np.float32], NDArray[np.float32]]]
"""Image (H, W, 3) RGB, sides multiples of 32 → scores (1, h, w) and edges (4, h, w)."""
LEVELS: tuple[tuple[float, float], ...] = ((0.0, 288.0), (96.0, np.inf))
"""Heights of bodies that are taken from the image, and from it at half size, px of the image."""
MULTIPLE, SEAM = 32, 96
"""Sides of an input are multiples of this; and the columns of a panorama that are repeated on both sides, px."""
LEAST_LOGIT, MOST = -4.5, 600
"""Least logit of a candidate, and number of candidates of a level."""


@dataclass(frozen=True, eq=False)
class Candidates:
    """boxes (n, 4): left, top, right, bottom px; logits (n,). The middle of a box in a panorama is in [0, W)."""

    boxes: Array
    logits: Array

    def select(self, rows: NDArray[np.int64] | NDArray[np.bool_]) -> Candidates:
        """The candidates in `rows`."""
        return Candidates(self.boxes[rows], self.logits[rows])


def candidates(network: Network, image: NDArray[np.uint8], wraps: bool) -> Candidates:
    """Candidates of both levels, before suppression. wraps: whether the image is a panorama."""
    parts = [_at_level(network, image, wraps, level) for level in range(len(LEVELS))]
    found = Candidates(np.concatenate([part.boxes for part in parts]), np.concatenate([part.logits for part in parts]))
    return found.select(np.argsort(-found.logits, kind="stable"))


def _at_level(network: Network, image: NDArray[np.uint8], wraps: bool, level: int) -> Candidates:
    scale, width = 2.0**level, image.shape[1]
    if wraps:
        image = np.concatenate([image[:, -SEAM:], image, image[:, :SEAM]], axis=1)
    if level:
        image = np.asarray(cv2.resize(image, None, fx=1 / scale, fy=1 / scale, interpolation=cv2.INTER_AREA), np.uint8)
    rows, columns = (-side % MULTIPLE for side in image.shape[:2])
    image = np.pad(image, ((0, rows), (0, columns), (0, 0)), mode="edge")
    scores, edges = network(image)
    peaks = (scores[0] >= cv2.dilate(scores[0], np.ones((3, 3), np.uint8))) & (scores[0] >= LEAST_LOGIT)
    at = np.stack(np.nonzero(peaks))
    logits = scores[0][at[0], at[1]].astype(np.float64)
    first = np.argsort(-logits, kind="stable")[:MOST]
    at, logits = at[:, first], logits[first]
    distance = np.exp(np.minimum(edges[:, at[0], at[1]].astype(np.float64), 8.0)).T
    centre = (at[::-1].T + 0.5) * STRIDE
    boxes = np.concatenate([centre - distance[:, :2], centre + distance[:, 2:]], axis=1) * scale
    if wraps:
        boxes[:, [0, 2]] -= SEAM
    height, middle = boxes[:, 3] - boxes[:, 1], (boxes[:, 0] + boxes[:, 2]) / 2
    good = (height >= LEVELS[level][0]) & (height < LEVELS[level][1]) & (middle >= 0) & (middle < width)
    return Candidates(boxes, logits).select(good)


def suppressed(found: Candidates, iou: float, period: float | None) -> Candidates:
    """Non-maximum suppression of sorted candidates: one that overlaps a surer one by more than `iou` is left out. period: width of a panorama."""
    alive = np.ones(len(found.logits), dtype=bool)
    for k in range(len(alive)):
        if alive[k]:
            alive[k + 1 :] &= box_overlaps(found.boxes[k : k + 1], found.boxes[k + 1 :], period)[0] <= iou
    return found.select(alive)
