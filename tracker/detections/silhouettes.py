"""People by their silhouettes, where a camera stands still: a second detector, which finds whom the first one misses and is there in every frame.

What differs from the backdrop (background.py) is explained by people: of all places on the ground the one is taken whose upright body
explains most, then the next of what is left, and then each is looked for once more beside the others. Bodies are three rectangles; what a pillar
lies over says nothing against anybody behind it, and what has been explained counts no more. The likelihood of a set of people is that of Fleuret
et al. 2008 (Multicamera people tracking with a probabilistic occupancy map), maximised greedily.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from tracker.detections.background import BackdropParameters, BackgroundModel
from tracker.detections.boxes import detections_from_boxes, drawn
from tracker.detections.ground_points import GroundDetections
from tracker.geometry import Array, Image, Ints, Mask, Pose
from tracker.geometry.cameras import Camera
from tracker.types import Detections, Setup

PARTS = np.array([[0.055, 0.02, 0.16], [0.115, 0.16, 0.5], [0.09, 0.5, 0.93]])
"""Head, trunk and legs: half the width, upper and lower end, as shares of the height from the head on. Shadows and shoes leave the last part open."""
WIDE = 0.2
"""Half the width of the box that is told of, of its height."""


@dataclass(frozen=True)
class SilhouetteParameters:
    """Pixels are those of the image at `width`."""

    width: int = 384  # px, images are scaled down to it
    shown: float = 0.85  # share of a body's pixels that differ from the backdrop ...
    stray: float = 0.03  # ... and of all others
    whole: float = 8.0  # log-likelihood that a body says which is all to be seen
    least: float = 1.8  # log-likelihood from which there is somebody
    size: float = 0.5  # power of a body's pixels by which those of different sizes are compared: 1 would prefer small ones, 0 large ones
    around: float = 0.03  # of a height, by which what a body explains is wider than it
    people: int = 40  # in an image, at most
    reach: float = 45.0  # m, nobody is looked for farther away ...
    margin: float = 3.0  # m, ... or so far beyond the area
    smallest: int = 12  # px, nor who is less tall
    steps: tuple[int, int] = (2, 1)  # px from place to place, along rows and columns
    stature: float = 1.8  # m, of people as boxes show them, at first ...
    weight: float = 30.0  # ... as if it had been seen so often
    sure: float = 0.6  # confidence from which boxes hold people
    backdrop: BackdropParameters = field(default_factory=BackdropParameters)


@dataclass(frozen=True, eq=False)
class Places:
    """Where somebody may stand: foot and head (n, 2) px, and whether pillars are behind that (n,)."""

    foot: Array
    head: Array
    front: Mask

    def select(self, rows: Mask | Ints) -> Places:
        """Those in `rows`."""
        return Places(self.foot[rows], self.head[rows], self.front[rows])


class Silhouettes:
    """The detector of one camera (T_world_camera) that stands still. State after an image depends on the images and boxes up to it alone."""

    def __init__(self, camera: Camera, pose: Pose, setup: Setup, parameters: SilhouetteParameters | None = None) -> None:
        self.camera, self.pose, self.setup, self.parameters = camera, pose, setup, parameters or SilhouetteParameters()
        p = self.parameters
        self.backdrop = BackgroundModel(setup.period, p.backdrop)
        self.shape = (max(round(p.width * camera.height / camera.width), 1), p.width)
        self._scale = p.width / camera.width, self.shape[0] / camera.height
        self._tall, self._weight = p.stature * p.weight, p.weight
        self._places: dict[int, Places] = {}
        self.foreground = np.zeros(self.shape, dtype=np.bool_)

    def step(self, image: Image, detections: Detections, feet: GroundDetections) -> Detections:
        """Take an image and the boxes that another detector found in it, with their feet; the people who are seen by their silhouettes."""
        p = self.parameters
        small = cv2.resize(image, (self.shape[1], self.shape[0]), interpolation=cv2.INTER_AREA)
        people = self._held(detections.confidence >= p.sure, detections)
        body, unknown = self.backdrop.step(np.asarray(small, dtype=np.uint8), people)
        self.foreground = body
        self._measure(feet)
        tall = round(self._tall / self._weight * 20)
        if tall not in self._places:
            self._places[tall] = self._standing(tall / 20)
        found, worth = explained(body, unknown, self.hidden, self._places[tall], p)
        height = found.foot[:, 1] - found.head[:, 1]
        boxes = np.column_stack([found.foot[:, 0] - WIDE * height, found.head[:, 1], 2 * WIDE * height, height]) / (*self._scale, *self._scale)
        boxes[:, :2] -= 0.5 - self.camera.pixel_centre
        return detections_from_boxes(self.camera, boxes, np.minimum(0.7 + 0.03 * worth, 0.99))

    @cached_property
    def hidden(self) -> Mask:
        """Pixels (H, W) that pillars lie over."""
        out, origin = np.zeros(self.shape, dtype=np.uint8), self.pose.translation
        for x, y, radius, low, high in self.setup.pillars:
            across = np.array([y - origin[1], origin[0] - x])
            left, right = (np.array([x, y]) + side * radius * across / np.hypot(*across) for side in (-1, 1))
            corners = np.array([[*left, low], [*right, low], [*right, high], [*left, high]])
            pixels, seen = self._pixels(corners)
            if seen.any() and np.isfinite(pixels).all():
                cv2.fillPoly(out, [pixels.round().astype(np.int32)], 1)
        return np.asarray(out > 0)

    def _pixels(self, points: Array) -> tuple[Array, Mask]:
        """Points (n, 3) m → (n, 2) px of the scaled image, from its corner, and whether they are in it."""
        sight = (points - self.pose.translation) @ self.pose.rotation
        pixels, inside = self.camera.pixels_from_bearings(sight / np.linalg.norm(sight, axis=1)[:, None])
        return (pixels + 0.5 - self.camera.pixel_centre) * self._scale, inside

    def _standing(self, stature: float) -> Places:
        """All places where somebody so tall may stand."""
        p, origin = self.parameters, self.pose.translation
        u, v = np.meshgrid(np.arange(0.5, self.shape[1], p.steps[0]), np.arange(0.5, self.shape[0], p.steps[1]))
        foot = np.column_stack([u.ravel(), v.ravel()])
        sight = self.camera.bearings_from_pixels(foot / self._scale - 0.5 + self.camera.pixel_centre) @ self.pose.rotation.T
        point, there = self.setup.ground.intersect(np.broadcast_to(origin, sight.shape), sight, p.reach)
        there &= self.setup.distance_beyond(point) <= p.margin
        foot, point = foot[there], point[there]
        head, _ = self._pixels(point + np.array([0.0, 0.0, stature]))
        distance = np.hypot(*(point - origin)[:, :2].T)
        nearest = min((np.hypot(*(row[:2] - origin[:2])) for row in self.setup.pillars), default=np.inf)
        with np.errstate(invalid="ignore"):
            upright = (foot[:, 1] - head[:, 1] >= p.smallest) & np.isfinite(head).all(axis=1)
        return Places(foot, head, distance < nearest).select(upright)

    def _measure(self, feet: GroundDetections) -> None:
        """Learn how tall people are as this camera's boxes show them: calibrations are off by some per cent."""
        low, high = self.setup.height
        tall = feet.height[feet.grounded & ~feet.hidden & (feet.confidence >= 0.9) & (feet.height > low + 0.1) & (feet.height < high - 0.1)]
        self._tall, self._weight = self._tall + float(tall.sum()), self._weight + len(tall)

    def _held(self, sure: Mask, detections: Detections) -> Mask:
        """Pixels (H, W) of the boxes that hold somebody for `sure` (n,), and a little more."""
        out = np.zeros(self.shape, dtype=np.bool_)
        middle, size = (pixels * self._scale for pixels in drawn(self.camera, detections))
        for (u, v), (w, h) in zip(middle[sure], size[sure], strict=True):
            if np.isfinite(u):
                box = np.round([u - 0.6 * w, v - 0.5 * h - 3, u + 0.6 * w, v + 0.5 * h + 3])
                left, top, right, bottom = np.clip(box, 0, np.tile(self.shape[::-1], 2)).astype(int)
                out[top:bottom, left:right] = True
        return out


def explained(body: Mask, unknown: Mask, hidden: Mask, places: Places, p: SilhouetteParameters) -> tuple[Places, Array]:
    """The people (n,) by whom the pixels that differ from a backdrop are explained, and what each says: log-likelihood of `body` (H, W) being so with
    the person over without, the others being there. unknown, hidden (H, W): pixels that say nothing, and that pillars lie over."""
    a, b = float(np.log(p.shown / p.stray)), float(np.log((1 - p.shown) / (1 - p.stray)))
    weight = np.where(body, a, b) * ~unknown * p.whole / a
    foot, head, front, taken = places.foot, places.head, places.front, np.zeros(body.shape, dtype=np.int64)
    if not body.any() or not len(foot):
        return places.select(np.zeros(0, dtype=np.int64)), np.zeros(0)

    def best(rows: Ints | None) -> tuple[int, Array]:
        free = np.where(taken == 0, weight, 0.0)
        # A pixel that differs is not covered by a pillar, whatever is known of that.
        sums = [np.asarray(cv2.integral(pixels), dtype=np.float64) for pixels in (np.where(hidden, np.maximum(free, 0.0), free), free)]
        some = np.arange(len(foot)) if rows is None else rows
        worth, rank = _worth((sums[0], sums[1]), (foot[some], head[some], front[some]), PARTS, p.size)
        return int(np.argmax(np.where(worth >= p.least, rank, -np.inf))), worth

    _, worth = best(None)
    rows = np.flatnonzero(worth >= p.least - 1)
    chosen: list[int] = []
    while len(rows) and len(chosen) < p.people:
        k, worth = best(rows)
        if worth[k] < p.least:
            break
        chosen.append(k)
        _paint(taken, foot[rows[k]], head[rows[k]], PARTS, (p.around, 1))
    said = np.zeros(len(chosen))
    for i, k in enumerate(chosen):
        _paint(taken, foot[rows[k]], head[rows[k]], PARTS, (p.around, -1))
        new, worth = best(rows)
        chosen[i] = new if worth[new] >= p.least else -1
        if chosen[i] >= 0:
            said[i] = worth[new]
            _paint(taken, foot[rows[new]], head[rows[new]], PARTS, (p.around, 1))
    kept = np.array(chosen, dtype=np.int64) >= 0
    return places.select(rows[np.array(chosen, dtype=np.int64)[kept]]), said[kept]


@njit(cache=True)
def _rectangle(foot: Array, head: Array, part: Array, shape: tuple[int, int]) -> tuple[int, int, int, int]:
    """Left, top, right and bottom px of a part of somebody, within an image of that shape."""
    tall = foot[1] - head[1]
    middle = head[0] + (foot[0] - head[0]) * (part[1] + part[2]) / 2
    left, right = round(middle - part[0] * tall), round(middle + part[0] * tall)
    top, bottom = round(head[1] + part[1] * tall), round(head[1] + part[2] * tall)
    return min(max(left, 0), shape[1]), min(max(top, 0), shape[0]), min(max(right, 0), shape[1]), min(max(bottom, 0), shape[0])


@njit(cache=True)
def _worth(sums: tuple[Array, Array], places: tuple[Array, Array, Mask], parts: Array, size: float) -> tuple[Array, Array]:
    """What is within each body (n,), a pixel of its size, by the integral images behind and before pillars; and a pixel of that power of its size."""
    foot, head, front = places
    worth, rank = np.empty(len(foot)), np.empty(len(foot))
    shape = (sums[0].shape[0] - 1, sums[0].shape[1] - 1)
    for k in range(len(foot)):
        S = sums[1] if front[k] else sums[0]
        total, area, tall = 0.0, 0.0, foot[k, 1] - head[k, 1]
        for part in parts:
            left, top, right, bottom = _rectangle(foot[k], head[k], part, shape)
            total += S[bottom, right] - S[top, right] - S[bottom, left] + S[top, left]
            area += 2 * part[0] * (part[2] - part[1]) * tall * tall
        worth[k], rank[k] = total / area, total / area**size
    return worth, rank


@njit(cache=True)
def _paint(taken: NDArray[np.int64], foot: Array, head: Array, parts: Array, by: tuple[float, int]) -> None:
    """Count what a body explains, wider by a share of its height, in place."""
    for part in parts:
        wide = part.copy()
        wide[0] += by[0]
        left, top, right, bottom = _rectangle(foot, head, wide, taken.shape)
        taken[top:bottom, left:right] += by[1]
