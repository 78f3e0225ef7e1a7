"""A synthetic street: people in two colours walk in front of a fixed camera, and a post may occlude them."""

from __future__ import annotations

from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from tracker.detections.boxes import detections_from_boxes
from tracker.geometry import Array, Pose
from tracker.geometry.cameras import pinhole
from tracker.geometry.ground import Flat
from tracker.types import Detections, Mount, Setup, Start, Tick, View

CAMERA, EYE = pinhole(768, 576, 0.8), Pose.planar(-22.0, 0.0, 0.0, 4.0)
POST = (-12.0, 0.0, 0.06, 0.0, 4.0)
"""A row of Setup.pillars."""
PERIOD, TALL, NAME = 1 / 7, 1.75, "View_001"
CLOTHES = (((200, 40, 40), (40, 40, 60)), ((40, 60, 190), (180, 170, 120)), ((230, 220, 90), (30, 90, 40)), ((20, 20, 25), (150, 60, 140)))


@dataclass
class Street:
    """post: whether the post exists. known: whether the setup holds it."""

    post: bool = False
    known: bool = True
    rng: np.random.Generator = field(default_factory=lambda: np.random.default_rng(0))

    def __post_init__(self) -> None:
        self.empty = cv2.resize(np.random.default_rng(9).integers(70, 190, (72, 96, 3)).astype(np.uint8), (CAMERA.width, CAMERA.height))

    @property
    def setup(self) -> Setup:
        pillars = np.array([POST]) if self.post and self.known else np.zeros((0, 5))
        mounts, starts = {NAME: Mount(CAMERA, Pose.identity(), NAME)}, {NAME: Start(EYE, np.zeros((6, 6)))}
        return Setup(mounts, Flat(), starts, PERIOD, area=np.array([[-10.0, -6.0], [8.0, 6.0]]), pillars=pillars)

    def image(self, people: Array) -> NDArray[np.uint8]:
        """The image of people at (n, 2) m; the row of a person selects the CLOTHES."""
        out = self.empty.copy()
        for k in np.argsort(-people[:, 0]):
            u, top, _, tall = box(people[k])
            trunk, legs = CLOTHES[k % len(CLOTHES)]
            middle = round(u + 0.21 * tall)
            cv2.ellipse(out, (middle, round(top + 0.08 * tall)), (round(0.05 * tall), round(0.08 * tall)), 0, 0, 360, (210, 160, 130), -1)
            cv2.ellipse(out, (middle, round(top + 0.34 * tall)), (round(0.13 * tall), round(0.21 * tall)), 0, 0, 360, trunk, -1)
            for side in (-1, 1):
                foot = round(middle + side * 0.06 * tall)
                cv2.line(out, (middle, round(top + 0.5 * tall)), (foot, round(top + 0.93 * tall)), legs, max(round(0.08 * tall), 1))
        if self.post:
            x, y, radius, low, high = POST
            (left, bottom), (right, top) = pixels(np.array([[x, y + radius, low], [x, y - radius, high]]))
            cv2.rectangle(out, (round(left), round(top)), (round(right), round(bottom)), (90, 90, 90), -1)
        return np.clip(out + self.rng.normal(0, 3, out.shape), 0, 255).astype(np.uint8)

    def tick(self, k: int, people: Array, found: NDArray[np.bool_]) -> Tick:
        """Tick k with detections of the people who are `found` (n,)."""
        return Tick(k, k * PERIOD, (View(NAME, detections(people[found]), image=self.image(people)),))


def pixels(points: Array) -> Array:
    """Pixels (n, 2) of points (n, 3) m."""
    sight = (points - EYE.translation) @ EYE.rotation
    return np.asarray(CAMERA.pixels_from_bearings(sight / np.linalg.norm(sight, axis=1, keepdims=True))[0])


def box(place: Array) -> Array:
    """Left, top, width, height px of a person at (2,) m."""
    (u, bottom), (_, top) = pixels(np.array([[*place, 0.0], [*place, TALL]]))
    return np.array([u - 0.21 * (bottom - top), top, 0.42 * (bottom - top), bottom - top])


def detections(people: Array) -> Detections:
    """Detections of people at (n, 2) m."""
    return detections_from_boxes(CAMERA, np.array([box(place) for place in people]).reshape(-1, 4), np.full(len(people), 0.95))
