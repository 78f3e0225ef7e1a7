"""The detector model with independent errors: boxes of visible parts with misses and noise, and false boxes. Seeded by its random stream.

It reports the box of the visible part of a body, as a detector on images does: the box ends above hidden feet.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from tracker.detections.boxes import detections_from_boxes
from tracker.detector_models.bodies import Place, SimulatedBoxes, TrueBodies
from tracker.detector_models.schema import Count, Numbers, Share, check_numbers
from tracker.geometry import Array, Mask, angles_from_bearing, bearing_from_angles
from tracker.geometry.cameras import Camera, PanoramicCamera
from tracker.types import Detections, ViewTruth

CONFIDENCE, LEAST_CONFIDENCE = (0.9, 0.08), 0.5
"""Mean and standard deviation of the confidences of people, and the lowest one."""
FALSE_CONFIDENCE = (0.3, 1.0)
"""Lowest and highest confidence of false boxes."""
# Heights and distances of the persons that false boxes would show, metres.
CLUTTER_HEIGHT = (1.5, 2.0)
CLUTTER_DISTANCE = (2.0, 8.0)
# Images other than panoramas: range of the ground at the lower edge of a false box, metres, and width of the box over its height.
CLUTTER_REACH = 60.0
CLUTTER_WIDTH = 0.35


@dataclass(frozen=True)
class IndependentErrors:
    """Misses (share), clutter (mean number a view), noise (rad, sigma of an edge), min_visible (fraction of the body).

    By default as in a scenario, but for clutter. In a file, each may be left out. Raises ValueError for values out of bounds.
    """

    misses: Share = 0.1
    clutter: Count = 0.0
    noise: Annotated[float, Numbers((), 0.0, 1.0)] = float(np.radians(0.15))
    min_visible: Share = 0.2

    def __post_init__(self) -> None:
        check_numbers(self)

    def detect(self, camera: Camera, view: ViewTruth, rng: np.random.Generator) -> Detections:
        """Detections in one view, without identity and in random order. The draws for one person do not depend on misses of other people."""
        found, noise, scores = self.draw(view.boxes.visible, view.boxes.seen, rng)
        if isinstance(camera, PanoramicCamera):
            edges = np.concatenate([(_edge_angles(camera, view.boxes.seen) + noise)[found], self._clutter(rng, view)])
        else:
            edges = np.concatenate([_shifted(camera, view.boxes.seen, noise)[found], self._pixel_clutter(rng, camera, view)])
        confidence = np.concatenate([scores[found], rng.uniform(*FALSE_CONFIDENCE, len(edges) - found.sum())])
        order = rng.permutation(len(edges))
        if not len(edges):
            return Detections.none()
        if isinstance(camera, PanoramicCamera):
            return self._detections(camera, edges[order], confidence[order])
        return self._pixel_detections(camera, edges[order], confidence[order])

    def draw(self, visible: Array, seen: Array, rng: np.random.Generator) -> tuple[Mask, Array, Array]:
        """Whether each person is found (n,), the noise of the edges (n, 4) rad, and confidences (n,).

        visible (n,): share of each body. seen (n, 4): edges px of its visible part.
        """
        n = len(visible)
        found = (rng.random(n) >= self.misses) & (visible >= self.min_visible) & (seen[:, 2] > seen[:, 0])
        return found, rng.normal(0.0, self.noise, (n, 4)), np.clip(rng.normal(*CONFIDENCE, n), LEAST_CONFIDENCE, 1.0)

    def _clutter(self, rng: np.random.Generator, view: ViewTruth) -> Array:
        count, eye = int(rng.poisson(self.clutter)), float(view.T_world_camera.translation[2]) - view.ground
        azimuth, distance, height = rng.uniform(-np.pi, np.pi, count), rng.uniform(*CLUTTER_DISTANCE, count), rng.uniform(*CLUTTER_HEIGHT, count)
        half = 0.25 / distance
        top, bottom = np.arctan2(height - eye, distance), np.arctan2(-eye, distance)
        return np.stack([azimuth + half, top, azimuth - half, bottom], axis=1).reshape(count, 4)

    def _pixel_clutter(self, rng: np.random.Generator, camera: Camera, view: ViewTruth) -> Array:
        """False boxes (n, 4) px whose lower edges are uniform over the pixels that show level ground within CLUTTER_REACH."""
        count, T = int(rng.poisson(self.clutter)), view.T_world_camera
        places = rng.uniform(0.0, [camera.width, camera.height], (64 * count, 2))
        bearings = camera.bearings_from_pixels(places) @ T.rotation.T
        drop = np.minimum(bearings[:, 2], -1e-9)
        feet = T.translation + bearings * ((view.ground - T.translation[2]) / drop)[:, None]
        near = np.flatnonzero((bearings[:, 2] < -1e-3) & (np.hypot(*(feet - T.translation)[:, :2].T) < CLUTTER_REACH))[:count]
        head = feet[near] + np.array([0.0, 0.0, 1.0]) * rng.uniform(*CLUTTER_HEIGHT, (len(near), 1))
        top, _ = camera.pixels_from_bearings(T.inverse().apply(head))
        high = np.where(np.isnan(top[:, 1]), 0.0, top[:, 1])
        half = CLUTTER_WIDTH / 2 * (places[near, 1] - high)
        return np.stack([places[near, 0] - half, high, places[near, 0] + half, places[near, 1]], axis=1) + (0.5 - camera.pixel_centre)

    def _detections(self, camera: PanoramicCamera, edges: Array, confidence: Array) -> Detections:
        left, top, right, bottom = edges.T
        bearing = bearing_from_angles((left + right) / 2, (top + bottom) / 2)
        extent = np.maximum(np.stack([left - right, top - bottom], axis=1), 1e-4)
        edge = self.noise**2 + (2 * np.pi / camera.width) ** 2 / 12
        # Azimuth is scaled to the circle of the elevation.
        covariance = _covariance(edge / 2 * np.cos((top + bottom) / 2) ** 2, np.full(len(edges), edge))
        return Detections(bearing, extent, confidence, covariance, np.zeros((len(edges), 0)))

    def _pixel_detections(self, camera: Camera, boxes: Array, confidence: Array) -> Detections:
        corner = boxes - (0.5 - camera.pixel_centre)
        size = np.maximum(corner[:, 2:] - corner[:, :2], 1.0)
        found = detections_from_boxes(camera, np.column_stack([corner[:, :2], size]), confidence)
        edge = self.noise**2 + _pixel_angle(camera, boxes)[:, 0] ** 2 / 12
        return Detections(found.bearing, found.extent, found.confidence, _covariance(edge / 2, edge), found.appearance)


class IndependentSampler:
    """The boxes of one view with these errors, frame by frame, without false boxes."""

    def __init__(self, errors: IndependentErrors, camera: Camera, rng: np.random.Generator) -> None:
        self.errors, self.camera, self.rng = errors, camera, rng

    def step(self, bodies: TrueBodies, place: Place) -> SimulatedBoxes:
        """The boxes of the next frame, of any place of the camera."""
        found, noise, confidence = self.errors.draw(bodies.visible, bodies.seen, self.rng)
        edges = _shifted(self.camera, bodies.seen, noise)
        boxes = np.column_stack([edges[:, :2], np.maximum(edges[:, 2:] - edges[:, :2], 1.0)])
        return SimulatedBoxes(boxes[found], confidence[found], bodies.person[found])


def _covariance(azimuth: Array, elevation: Array) -> Array:
    """Covariances (n, 2, 2) rad² from variances. The centre of two edges has half the variance of an edge."""
    covariance = np.zeros((len(elevation), 2, 2))
    covariance[:, 0, 0], covariance[:, 1, 1] = np.maximum(azimuth, 1e-8), elevation
    return covariance


def _pixel_angle(camera: Camera, boxes: Array) -> Array:
    """Angle (n, 1) of a pixel, rad, at the centre of each box (n, 4) px; 1 where the camera has none."""
    middle = (boxes[:, :2] + boxes[:, 2:]) / 2
    above, below = (camera.bearings_from_pixels(middle + np.array([0.0, dv])) for dv in (-0.5, 0.5))
    angle = np.linalg.norm(above - below, axis=1)
    return np.asarray(np.where(np.isfinite(angle) & (angle > 0), angle, 1.0)[:, None])


def _shifted(camera: Camera, boxes: Array, noise: Array) -> Array:
    """Boxes (n, 4) px with their edges shifted by noise (n, 4) rad."""
    return boxes + noise / _pixel_angle(camera, boxes)


def _edge_angles(camera: PanoramicCamera, boxes: Array) -> Array:
    """Pixel boxes (n, 4) left, top, right, bottom → azimuth of left, elevation of top, azimuth of right, elevation of bottom, radians.

    Azimuths are unwrapped: the right edge is below the left one by the span.
    """
    left, top = angles_from_bearing(camera.bearings_from_pixels(boxes[:, :2]))
    bottom = camera.elevations_from_rows(boxes[:, 3])
    span = 2 * np.pi * (boxes[:, 2] - boxes[:, 0]) / camera.width
    return np.stack([left, top, left - span, bottom], axis=1)
