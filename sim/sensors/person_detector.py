"""Simulated detector of people: true boxes from instance images, then noise, misses and clutter. Pure functions, seeded.

The detector reports the box of the visible part of a body, as a detector on images does: above hidden feet, the box ends.
Its detections carry no identity and are in random order.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.rendering.coverage import UnoccludedExtent
from sim.scenario import Scenario
from sim.sensors.keypoints import InstanceImage, true_keypoints
from tracker.detections.boxes import detections_from_boxes
from tracker.geometry import Array, Ints, Pose, angles_from_bearing, bearing_from_angles
from tracker.geometry.cameras import Camera, PanoramicCamera
from tracker.geometry.compilation import njit
from tracker.types import KEYPOINT_NAMES, Boxes, Detections, Keypoints, ViewTruth
from worlds.world import World

# A false box is that of a person of this height at this distance, metres.
CLUTTER_HEIGHT = (1.5, 2.0)
CLUTTER_DISTANCE = (2.0, 8.0)
# In images that are no panoramas, its lower edge shows the ground within this range, metres, and this is its aspect ratio.
CLUTTER_REACH = 60.0
CLUTTER_WIDTH = 0.35
HIPS = [KEYPOINT_NAMES.index(f"{side}_hip") for side in ("left", "right")]
"""Indices of the hips among the key points."""


@dataclass(frozen=True, eq=False)
class People:
    """The people who are present: person (m,) ids; joints (m, 17, 3) m, world, in the order of KEYPOINT_NAMES."""

    person: Ints
    joints: Array


def true_view(image: InstanceImage, people: People, unoccluded: Sequence[UnoccludedExtent], world: World) -> ViewTruth:
    """Truth of a view. unoccluded (m,): extent of each person without occlusion."""
    return truth_above(world, image.T_world_camera, *seen_people(image, people, unoccluded))


def seen_people(image: InstanceImage, people: People, unoccluded: Sequence[UnoccludedExtent]) -> tuple[Boxes, Keypoints]:
    """True boxes and key points of the people in a view; arguments as of `true_view`."""
    boxes = true_boxes(image, people, unoccluded)
    shown = np.flatnonzero([body.pixels > 0 for body in unoccluded])
    return boxes, true_keypoints(image, people.person[shown], people.joints[shown]) if len(shown) else Keypoints.none()


def truth_above(world: World, T_world_camera: Pose, boxes: Boxes, keypoints: Keypoints) -> ViewTruth:
    """Truth of a view with these people, with the ground below the camera."""
    below = T_world_camera.translation[None]
    ground, normal = world.terrain.height_at(below), world.terrain.normal_at(below)
    return ViewTruth(T_world_camera, float(ground[0]), normal[0], boxes, keypoints)


def true_boxes(image: InstanceImage, people: People, unoccluded: Sequence[UnoccludedExtent]) -> Boxes:
    """True boxes of all people who are in the image or would be without occlusion.

    unoccluded (m,): extent of each person without occlusion. In a panorama a box across the seam has left in [0, W) and right > W.
    visible: visible pixels over unoccluded pixels. People without an unoccluded pixel are left out.
    """
    seam = image.instances.shape[1] if image.camera.wraps else None
    present = people.person.tolist()
    pixels, rows, used = _extents(image.instances, _slots(present), len(present))
    kept, seen, visible = [], [], []
    for k, (_, body) in enumerate(zip(present, unoccluded, strict=True)):
        if not body.pixels:
            continue
        kept.append(k)
        seen.append(_box(rows[k], used[k], seam))
        visible.append(pixels[k] / body.pixels)
    if not kept:
        return Boxes.none()
    middle = people.joints[kept][:, HIPS].mean(axis=1)
    distance = np.linalg.norm(middle - image.T_world_camera.translation, axis=1)
    return Boxes(people.person[kept], np.array(seen), np.array([unoccluded[k].box for k in kept]), np.array(visible), distance)


def _slots(persons: list[int]) -> NDArray[np.int64]:
    """Table (65536,) from an instance to its place among `persons`, −1 for others."""
    slots = np.full(1 << 16, -1)
    slots[persons] = np.arange(len(persons))
    return slots


@njit(cache=True)
def _extents(instances, slots, count):  # type: ignore[no-untyped-def]
    """Pixels (count,), first and last row (count, 2), and used columns (count, W) of the instances (H, W)."""
    height, width = instances.shape
    pixels, rows, columns = np.zeros(count, np.int64), np.zeros((count, 2), np.int64), np.zeros((count, width), np.bool_)
    for i in range(height):
        for j in range(width):
            instance = instances[i, j]
            if instance == 0:
                continue
            k = slots[instance]
            if k < 0:
                continue
            if pixels[k] == 0:
                rows[k, 0] = i
            rows[k, 1] = i
            pixels[k] += 1
            columns[k, j] = True
    return pixels, rows, columns


def _box(rows: NDArray[np.int64], columns: NDArray[np.bool_], seam: int | None) -> Array:
    """Edges left, top, right, bottom (4,) from the first and last row (2,) and the used columns (W,); zeros where none is used.

    seam: width of a panorama, whose boxes may cross it, else None.
    """
    used = np.flatnonzero(columns)
    if not len(used):
        return np.zeros(4)
    if seam is None:
        return np.array([used[0], rows[0], used[-1] + 1, rows[1] + 1], dtype=np.float64)
    # The widest cyclic gap between used columns is outside of the body.
    gaps = np.diff(used, append=used[0] + seam)
    gap = int(np.argmax(gaps))
    left = int(used[(gap + 1) % len(used)])
    right = int(used[gap]) + (seam if used[gap] < left else 0)
    return np.array([left, rows[0], right + 1, rows[1] + 1], dtype=np.float64)


@dataclass(frozen=True)
class Detector:
    """Detector model: misses (share), clutter (mean number a view), noise (rad, sigma of an edge), min_visible (fraction of the body)."""

    misses: float
    clutter: float
    noise: float
    min_visible: float

    @staticmethod
    def of(scenario: Scenario) -> Detector:
        return Detector(scenario.misses, scenario.clutter, scenario.bearing_noise, scenario.min_visible)

    def detect(self, camera: Camera, view: ViewTruth, rng: np.random.Generator) -> Detections:
        """Detections in one view. The random draws for one person do not depend on whether another one was missed."""
        boxes = view.boxes
        n = len(boxes.person)
        found = (rng.random(n) >= self.misses) & (boxes.visible >= self.min_visible) & (boxes.seen[:, 2] > boxes.seen[:, 0])
        noise, scores = rng.normal(0.0, self.noise, (n, 4)), np.clip(rng.normal(0.9, 0.08, n), 0.5, 1.0)
        if isinstance(camera, PanoramicCamera):
            edges = np.concatenate([(_edge_angles(camera, boxes.seen) + noise)[found], self._clutter(rng, view)])
        else:
            edges = np.concatenate([_shifted(camera, boxes.seen, noise)[found], self._pixel_clutter(rng, camera, view)])
        confidence = np.concatenate([scores[found], rng.uniform(0.3, 1.0, len(edges) - found.sum())])
        order = rng.permutation(len(edges))
        if isinstance(camera, PanoramicCamera):
            return self._detections(camera, edges[order], confidence[order])
        return self._pixel_detections(camera, edges[order], confidence[order])

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
        if not len(edges):
            return Detections.none()
        left, top, right, bottom = edges.T
        bearing = bearing_from_angles((left + right) / 2, (top + bottom) / 2)
        extent = np.maximum(np.stack([left - right, top - bottom], axis=1), 1e-4)
        pixel = 2 * np.pi / camera.width
        edge = self.noise**2 + pixel**2 / 12
        # The centre of two edges has half their variance; azimuth is scaled to the circle of the elevation.
        azimuth = edge / 2 * np.cos((top + bottom) / 2) ** 2
        covariance = np.zeros((len(edges), 2, 2))
        covariance[:, 0, 0], covariance[:, 1, 1] = np.maximum(azimuth, 1e-8), edge
        return Detections(bearing, extent, confidence, covariance, np.zeros((len(edges), 0)))

    def _pixel_detections(self, camera: Camera, boxes: Array, confidence: Array) -> Detections:
        if not len(boxes):
            return Detections.none()
        corner = boxes - (0.5 - camera.pixel_centre)
        size = np.maximum(corner[:, 2:] - corner[:, :2], 1.0)
        found = detections_from_boxes(camera, np.column_stack([corner[:, :2], size]), confidence)
        edge = self.noise**2 + _pixel_angle(camera, boxes)[:, 0] ** 2 / 12
        covariance = np.zeros((len(boxes), 2, 2))
        # As in a panorama, the centre of two edges has half their variance.
        covariance[:, 0, 0], covariance[:, 1, 1] = np.maximum(edge / 2, 1e-8), edge
        return Detections(found.bearing, found.extent, found.confidence, covariance, found.appearance)


def _pixel_angle(camera: Camera, boxes: Array) -> Array:
    """Angle (n, 1) of a pixel, rad, at the centre of each box (n, 4) px."""
    middle = (boxes[:, :2] + boxes[:, 2:]) / 2
    above, below = (camera.bearings_from_pixels(middle + np.array([0.0, dv])) for dv in (-0.5, 0.5))
    return np.asarray(np.linalg.norm(above - below, axis=1)[:, None])


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
