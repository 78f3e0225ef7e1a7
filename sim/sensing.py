"""From truth and instances to what sensors report: boxes of people with noise, misses and clutter. Pure, seeded.

The detector of the simulator sees the box of the visible part of a body, as a detector on images does: where the feet are hidden, the
box ends above them. What it reports carries no identity and comes in no telling order.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.panorama import Alone
from sim.scenario import Scenario
from tracker.cameras import Panorama
from tracker.geometry import Array, angles_from_bearing, bearing_from_angles
from tracker.measurements import Detections
from tracker.sequence import Boxes

# A false box is what a person of this height would leave at this distance, metres.
CLUTTER_HEIGHT = (1.5, 2.0)
CLUTTER_DISTANCE = (2.0, 8.0)


def true_boxes(instances: NDArray[np.uint16], persons: Sequence[int], alone: Sequence[Alone]) -> Boxes:
    """Boxes of all people that a panorama shows or would show without occlusion.

    instances (H, W), persons (m,) ids, alone (m,) what each would cover by itself. A box over the seam has left in [0, W) and right
    beyond W. visible = pixels seen / pixels alone; people with no pixel alone are left out.
    """
    width = instances.shape[1]
    rows, columns = np.nonzero(instances)
    owner = instances[rows, columns]
    order = np.argsort(owner, kind="stable")
    rows, columns, owner = rows[order], columns[order], owner[order]
    kept, seen, full, visible = [], [], [], []
    for person, body in zip(persons, alone, strict=True):
        if not body.pixels:
            continue
        first, last = np.searchsorted(owner, [person, person + 1])
        kept.append(int(person))
        seen.append(_box(rows[first:last], columns[first:last], width))
        full.append(body.box)
        visible.append((last - first) / body.pixels)
    n = len(kept)
    return Boxes(np.array(kept, dtype=np.int64), np.array(seen).reshape(n, 4), np.array(full).reshape(n, 4), np.array(visible).reshape(n))


def _box(rows: NDArray[np.int64], columns: NDArray[np.int64], width: int) -> Array:
    """Edges left, top, right, bottom of some pixels; around the seam where the body lies over it; zeros where there is no pixel."""
    if not len(rows):
        return np.zeros(4)
    used = np.unique(columns)
    # The widest gap between columns, around the seam too, is what lies beside the body.
    gaps = np.diff(used, append=used[0] + width)
    gap = int(np.argmax(gaps))
    left = int(used[(gap + 1) % len(used)])
    right = int(used[gap]) + (width if used[gap] < left else 0)
    return np.array([left, rows.min(), right + 1, rows.max() + 1], dtype=np.float64)


@dataclass(frozen=True)
class Detector:
    """The simulator's detector: misses (share), clutter (mean a view), noise rad an edge, min_visible (fraction of the body)."""

    misses: float
    clutter: float
    noise: float
    min_visible: float

    @staticmethod
    def of(scenario: Scenario) -> Detector:
        return Detector(scenario.misses, scenario.clutter, scenario.bearing_noise, scenario.min_visible)

    def detect(self, camera: Panorama, boxes: Boxes, camera_height: float, rng: np.random.Generator) -> Detections:
        """What is reported of the true boxes in one view; camera_height m is the lens over the ground, for the false boxes' feet.

        In a frame the draws of one person do not depend on whether another was missed.
        """
        n = len(boxes.person)
        found = (rng.random(n) >= self.misses) & (boxes.visible >= self.min_visible) & (boxes.seen[:, 2] > boxes.seen[:, 0])
        noise, sure = rng.normal(0.0, self.noise, (n, 4)), np.clip(rng.normal(0.9, 0.08, n), 0.5, 1.0)
        edges = np.concatenate([(_edges(camera, boxes.seen) + noise)[found], self._false(rng, camera_height)])
        confidence = np.concatenate([sure[found], rng.uniform(0.3, 1.0, len(edges) - found.sum())])
        order = rng.permutation(len(edges))
        return self._report(camera, edges[order], confidence[order])

    def _false(self, rng: np.random.Generator, camera_height: float) -> Array:
        count = int(rng.poisson(self.clutter))
        azimuth, distance, height = rng.uniform(-np.pi, np.pi, count), rng.uniform(*CLUTTER_DISTANCE, count), rng.uniform(*CLUTTER_HEIGHT, count)
        half = 0.25 / distance
        top, bottom = np.arctan2(height - camera_height, distance), np.arctan2(-camera_height, distance)
        return np.stack([azimuth + half, top, azimuth - half, bottom], axis=1).reshape(count, 4)

    def _report(self, camera: Panorama, edges: Array, confidence: Array) -> Detections:
        if not len(edges):
            return Detections.none()
        left, top, right, bottom = edges.T
        bearing = bearing_from_angles((left + right) / 2, (top + bottom) / 2)
        extent = np.maximum(np.stack([left - right, top - bottom], axis=1), 1e-4)
        pixel = np.pi / camera.height
        edge = self.noise**2 + pixel**2 / 12
        # The middle between two edges has half their variance, along the smaller circle of its elevation.
        azimuth = edge / 2 * np.cos((top + bottom) / 2) ** 2
        covariance = np.zeros((len(edges), 2, 2))
        covariance[:, 0, 0], covariance[:, 1, 1] = np.maximum(azimuth, 1e-8), edge
        return Detections(bearing, extent, confidence, covariance, np.zeros((len(edges), 0)))


def _edges(camera: Panorama, boxes: Array) -> Array:
    """Pixel boxes (n, 4) left, top, right, bottom → azimuth of left, elevation of top, azimuth of right, elevation of bottom, radians.

    Azimuths are unwrapped: the right edge is below the left one by the span.
    """
    left, top = angles_from_bearing(camera.bearings_from_pixels(boxes[:, :2]))
    bottom = np.pi / 2 - np.pi * boxes[:, 3] / camera.height
    span = 2 * np.pi * (boxes[:, 2] - boxes[:, 0]) / camera.width
    return np.stack([left, top, left - span, bottom], axis=1)
