"""Person detector by silhouettes, for fixed cameras: it needs no training and complements the boxes of another detector.

The foreground of background.py is explained by upright bodies on the ground. The place whose body explains most is taken, then the next one of the
rest, and so on. Finally each body is chosen once more, given the others. A body is three rectangles. Pixels under a pillar are no evidence
against a person behind it, and pixels that a body explains count once. The likelihood of a set of people is that of Fleuret et al. 2008
(Multicamera people tracking with a probabilistic occupancy map), maximized greedily.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from tracker.detections.background import BackgroundModel
from tracker.detections.boxes import approximate_pixel_boxes, detections_from_boxes
from tracker.detections.ground_points import GroundDetections
from tracker.geometry import Array, Image, Ints, Mask, Pose
from tracker.geometry.cameras import Camera
from tracker.geometry.compilation import njit
from tracker.types import Detections, Setup

PARTS = np.array([[0.055, 0.02, 0.16], [0.115, 0.16, 0.5], [0.09, 0.5, 0.93]])
"""Head, trunk and legs: half the width, upper and lower end, as shares of the height, from the head. Shadows and shoes are left out below."""
HALF_WIDTH = 0.2
"""Half the width of the box that is reported, as a share of its height."""
FARTHEST_PIXEL = 10_000
"""Largest coordinate of a corner of a pillar, which is drawn in whole numbers."""


WIDTH = 384
"""px, images are scaled down to it; all that follows in px is of such an image."""
BODY_FOREGROUND, OTHER_FOREGROUND = 0.85, 0.03
"""Shares of a body's pixels, and of other pixels, that are foreground."""
FULL_SCORE, MIN_SCORE = 8.0, 1.8
"""Log-likelihood ratio of a body that is wholly visible, and the one from which a body is a person."""
SIZE_POWER = 0.5
"""Power of a body's size by which scores are divided: 1 would favour small bodies, 0 large ones."""
EXPLAINED_MARGIN = 0.03
"""Share of the height by which the explained area is wider than the body on either side."""
MAX_PEOPLE = 40
"""Largest number of people in an image."""
REACH, AREA_MARGIN = 45.0, 3.0
"""m, greatest distance of a body, and greatest distance beyond the area."""
MIN_HEIGHT, STEPS = 12, (2, 1)
"""px, least height of a body, and steps between candidate places along rows and columns."""
STATURE, STATURE_WEIGHT = 1.8, 30.0
"""m, mean of people as boxes show them, before any are measured; number of measurements for which it counts."""
MIN_CONFIDENCE, SURE = 0.6, 0.9
"""Least confidence of boxes whose pixels count as those of people, and of boxes that measure statures."""


@dataclass(frozen=True, eq=False)
class CandidateBodies:
    """Bodies at candidate places: foot and head (n, 2) px; front (n,): the body is nearer than every pillar."""

    foot: Array
    head: Array
    front: Mask

    def select(self, rows: Mask | Ints) -> CandidateBodies:
        """The bodies in `rows`."""
        return CandidateBodies(self.foot[rows], self.head[rows], self.front[rows])


class Silhouettes:
    """The detector of one fixed camera; causal: its state depends on the images and boxes so far.

    pose: T_world_camera. The attribute `foreground` (H, W) holds that of the last image, at the size to which images are scaled.
    """

    def __init__(self, camera: Camera, pose: Pose, setup: Setup, width: int = WIDTH) -> None:
        self.camera, self.pose, self.setup = camera, pose, setup
        self.background = BackgroundModel(setup.period)
        self.shape = (max(round(width * camera.height / camera.width), 1), width)
        self._scale = width / camera.width, self.shape[0] / camera.height
        self._stature_sum, self._weight = STATURE * STATURE_WEIGHT, STATURE_WEIGHT
        self._candidates: dict[int, CandidateBodies] = {}
        self.foreground = np.zeros(self.shape, dtype=np.bool_)

    def step(self, image: Image, detections: Detections, feet: GroundDetections, elapsed: float | None = None) -> Detections:
        """Boxes of the people in an image (h, w, 3) by their silhouettes.

        detections and feet: the boxes of another detector in it, as angles and on the ground.
        elapsed: s since the image before, the period by default.
        """
        small = cv2.resize(image, (self.shape[1], self.shape[0]), interpolation=cv2.INTER_AREA)
        people = self._box_mask(detections.confidence >= MIN_CONFIDENCE, detections)
        body, unknown = self.background.step(np.asarray(small, dtype=np.uint8), people, elapsed)
        self.foreground = body
        self._learn_stature(feet)
        stature = round(self._stature_sum / self._weight * 20)
        if stature not in self._candidates:
            self._candidates[stature] = self._candidate_bodies(stature / 20)
        found, score = explain_foreground(body, unknown, self.hidden, self._candidates[stature])
        height = found.foot[:, 1] - found.head[:, 1]
        boxes = np.column_stack([found.foot[:, 0] - HALF_WIDTH * height, found.head[:, 1], 2 * HALF_WIDTH * height, height]) / (
            *self._scale,
            *self._scale,
        )
        boxes[:, :2] -= 0.5 - self.camera.pixel_centre
        return detections_from_boxes(self.camera, boxes, np.minimum(0.7 + 0.03 * score, 0.99))

    @cached_property
    def hidden(self) -> Mask:
        """Pixels (H, W) that pillars cover."""
        out, origin = np.zeros(self.shape, dtype=np.uint8), self.pose.translation
        for x, y, radius, low, high in self.setup.pillars:
            across = np.array([y - origin[1], origin[0] - x])
            left, right = (np.array([x, y]) + side * radius * across / np.hypot(*across) for side in (-1, 1))
            corners = np.array([[*left, low], [*right, low], [*right, high], [*left, high]])
            pixels = self._pixels(corners)
            if np.isfinite(pixels).all():
                # Corners of a pillar that crosses the whole image are far outside it.
                cv2.fillPoly(out, [np.clip(pixels.round(), -FARTHEST_PIXEL, FARTHEST_PIXEL).astype(np.int32)], 1)
        return np.asarray(out > 0)

    def _pixels(self, points: Array) -> Array:
        """Pixels (n, 2) of points (n, 3) m in the scaled image, from its corner; NaN where the camera cannot project them."""
        rays = (points - self.pose.translation) @ self.pose.rotation
        pixels, _ = self.camera.pixels_from_bearings(rays / np.linalg.norm(rays, axis=1)[:, None])
        return (pixels + 0.5 - self.camera.pixel_centre) * self._scale

    def _candidate_bodies(self, stature: float) -> CandidateBodies:
        """Bodies of that stature (m) at all candidate places."""
        origin = self.pose.translation
        u, v = np.meshgrid(np.arange(0.5, self.shape[1], STEPS[0]), np.arange(0.5, self.shape[0], STEPS[1]))
        foot = np.column_stack([u.ravel(), v.ravel()])
        rays = self.camera.bearings_from_pixels(foot / self._scale - 0.5 + self.camera.pixel_centre) @ self.pose.rotation.T
        point, grounded = self.setup.ground.intersect(np.broadcast_to(origin, rays.shape), rays, REACH)
        grounded &= self.setup.distance_beyond(point) <= AREA_MARGIN
        foot, point = foot[grounded], point[grounded]
        head = self._pixels(point + np.array([0.0, 0.0, stature]))
        distance = np.hypot(*(point - origin)[:, :2].T)
        nearest = min((np.hypot(*(row[:2] - origin[:2])) for row in self.setup.pillars), default=np.inf)
        with np.errstate(invalid="ignore"):
            upright = (foot[:, 1] - head[:, 1] >= MIN_HEIGHT) & np.isfinite(head).all(axis=1)
        return CandidateBodies(foot, head, distance < nearest).select(upright)

    def _learn_stature(self, feet: GroundDetections) -> None:
        """Learn the mean stature as this camera's boxes show it: calibrations err by some per cent."""
        low, high = self.setup.height
        tall = feet.height[feet.grounded & ~feet.occludable & (feet.confidence >= SURE) & (feet.height > low + 0.1) & (feet.height < high - 0.1)]
        self._stature_sum, self._weight = self._stature_sum + float(tall.sum()), self._weight + len(tall)

    def _box_mask(self, chosen: Mask, detections: Detections) -> Mask:
        """Pixels (H, W) of the `chosen` (n,) boxes with a margin."""
        out = np.zeros(self.shape, dtype=np.bool_)
        middle, size = (pixels * self._scale for pixels in approximate_pixel_boxes(self.camera, detections))
        for (u, v), (w, h) in zip(middle[chosen], size[chosen], strict=True):
            if np.isfinite(u):
                box = np.round([u - 0.6 * w, v - 0.5 * h - 3, u + 0.6 * w, v + 0.5 * h + 3])
                left, top, right, bottom = np.clip(box, 0, np.tile(self.shape[::-1], 2)).astype(int)
                out[top:bottom, left:right] = True
        return out


def explain_foreground(body: Mask, unknown: Mask, hidden: Mask, bodies: CandidateBodies) -> tuple[CandidateBodies, Array]:
    """The people who explain a foreground `body` (H, W), and their scores (n,).

    A score is the log-likelihood ratio of the foreground with the person over without, given the others.
    unknown, hidden (H, W): pixels without evidence, and pixels that pillars cover.
    """
    a, b = float(np.log(BODY_FOREGROUND / OTHER_FOREGROUND)), float(np.log((1 - BODY_FOREGROUND) / (1 - OTHER_FOREGROUND)))
    weight = np.where(body, a, b) * ~unknown * FULL_SCORE / a
    foot, head, front, taken = bodies.foot, bodies.head, bodies.front, np.zeros(body.shape, dtype=np.int64)
    if not body.any() or not len(foot):
        return bodies.select(np.zeros(0, dtype=np.int64)), np.zeros(0)

    def best(rows: Ints | None) -> tuple[int, Array]:
        free = np.where(taken == 0, weight, 0.0)
        # A foreground pixel is not covered by a pillar, whatever the map of pillars says.
        sums = [np.asarray(cv2.integral(pixels), dtype=np.float64) for pixels in (np.where(hidden, np.maximum(free, 0.0), free), free)]
        some = np.arange(len(foot)) if rows is None else rows
        score, rank = _scores((sums[0], sums[1]), (foot[some], head[some], front[some]), PARTS, SIZE_POWER)
        return int(np.argmax(np.where(score >= MIN_SCORE, rank, -np.inf))), score

    _, score = best(None)
    rows = np.flatnonzero(score >= MIN_SCORE - 1)
    chosen: list[int] = []
    while len(rows) and len(chosen) < MAX_PEOPLE:
        k, score = best(rows)
        if score[k] < MIN_SCORE:
            break
        chosen.append(k)
        _count_explained(taken, foot[rows[k]], head[rows[k]], PARTS, (EXPLAINED_MARGIN, 1))
    final = np.zeros(len(chosen))
    for i, k in enumerate(chosen):
        _count_explained(taken, foot[rows[k]], head[rows[k]], PARTS, (EXPLAINED_MARGIN, -1))
        new, score = best(rows)
        chosen[i] = new if score[new] >= MIN_SCORE else -1
        if chosen[i] >= 0:
            final[i] = score[new]
            _count_explained(taken, foot[rows[new]], head[rows[new]], PARTS, (EXPLAINED_MARGIN, 1))
    kept = np.array(chosen, dtype=np.int64) >= 0
    return bodies.select(rows[np.array(chosen, dtype=np.int64)[kept]]), final[kept]


@njit(cache=True)
def _rectangle(foot: Array, head: Array, part: Array, shape: tuple[int, int]) -> tuple[int, int, int, int]:
    """Left, top, right and bottom px of a part of a body, clipped to an image of that shape."""
    tall = foot[1] - head[1]
    middle = head[0] + (foot[0] - head[0]) * (part[1] + part[2]) / 2
    left, right = round(middle - part[0] * tall), round(middle + part[0] * tall)
    top, bottom = round(head[1] + part[1] * tall), round(head[1] + part[2] * tall)
    return min(max(left, 0), shape[1]), min(max(top, 0), shape[0]), min(max(right, 0), shape[1]), min(max(bottom, 0), shape[0])


@njit(cache=True)
def _scores(sums: tuple[Array, Array], bodies: tuple[Array, Array, Mask], parts: Array, size_power: float) -> tuple[Array, Array]:
    """Sum of the weights within each body (n,) over its area, and over that power of its area; sums: integral images behind and before pillars."""
    foot, head, front = bodies
    score, rank = np.empty(len(foot)), np.empty(len(foot))
    shape = (sums[0].shape[0] - 1, sums[0].shape[1] - 1)
    for k in range(len(foot)):
        S = sums[1] if front[k] else sums[0]
        total, area, tall = 0.0, 0.0, foot[k, 1] - head[k, 1]
        for part in parts:
            left, top, right, bottom = _rectangle(foot[k], head[k], part, shape)
            total += S[bottom, right] - S[top, right] - S[bottom, left] + S[top, left]
            area += 2 * part[0] * (part[2] - part[1]) * tall * tall
        score[k], rank[k] = total / area, total / area**size_power
    return score, rank


@njit(cache=True)
def _count_explained(taken: NDArray[np.int64], foot: Array, head: Array, parts: Array, by: tuple[float, int]) -> None:
    """Add by[1] to the pixels that a body explains, in place; by[0]: share of the height by which these extend on either side."""
    for part in parts:
        wide = part.copy()
        wide[0] += by[0]
        left, top, right, bottom = _rectangle(foot, head, wide, taken.shape)
        taken[top:bottom, left:right] += by[1]
