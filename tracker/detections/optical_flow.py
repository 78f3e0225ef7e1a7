"""Tracklets by images: where the box of this frame was some frames ago, as its corners tell that are followed back through the images.

A box of now and a box of k frames ago are one person where the corners of the one (Shi and Tomasi 1994) lead into the other (pyramidal Lucas-Kanade,
Bouguet 2001). Each step of a box is voted among its corners. What that is worth is a log-likelihood ratio, so that it adds to what the ground says.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from tracker.detections.boxes import drawn
from tracker.geometry import Array, Image, Ints
from tracker.geometry.cameras import Camera, Panorama
from tracker.types import Detections

Gray = NDArray[np.uint8]

WINDOW, LEVELS = (15, 15), 3
"""px and levels of the pyramid of Lucas-Kanade."""
LONGEST = 15
"""Frames that are looked back at most."""
PAD = 1 / 8
"""Of a panorama's width that is put on again beyond either side of its seam."""


@dataclass(frozen=True)
class TrackletParameters:
    """Named as in the paper where it has a name for it; pixels are those of the image at half its size."""

    l_c: int = 4  # frames that corners are followed back
    delta_min: float = 0.05  # px, a corner that moves less is static
    omega: float = 0.3  # of a box's width: corners of one body move alike within it
    corners: int = 100  # of a box at most ...
    least: int = 4  # ... and at least
    inside: float = 0.7  # of a box's width, about its middle, where corners are taken
    sigma: float = 0.25  # of a box's width: how far the middle of the right box is from where its corners lead
    astray: float = 0.05  # share of boxes whose corners follow something else

    def __post_init__(self) -> None:
        if not 1 <= self.l_c <= LONGEST:
            raise ValueError(f"l_c is {self.l_c}, needs 1 to {LONGEST}")
        for name in ("delta_min", "omega", "sigma"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name} is {getattr(self, name)}, needs more than 0")


@dataclass(frozen=True, eq=False)
class Frames:
    """What is kept of a frame: the image at half its size, grey, and goes on beyond a panorama's seam; turn: px of a whole turn, inf for others;
    middle (n, 2), NaN for who cannot be drawn, and size (n, 2) px of its boxes.
    """

    gray: Gray
    turn: float
    middle: Array
    size: Array

    def corners(self, box: int, p: TrackletParameters) -> Array:
        """(k, 2) px within a box, but where a nearer one (its lower edge is lower) stands before it; none where there are too few."""
        if not np.isfinite(self.middle[box]).all():
            return np.zeros((0, 2))
        half = self.size[box] / 2 * [p.inside, 0.9]
        low = np.maximum(np.floor(self.middle[box] - half).astype(int), 0)
        high = np.minimum(np.ceil(self.middle[box] + half).astype(int), self.gray.shape[::-1])
        if (high - low < 4).any():
            return np.zeros((0, 2))
        mask = np.full(high[::-1] - low[::-1], 255, dtype=np.uint8)
        bottom = self.middle[:, 1] + self.size[:, 1] / 2
        for other in np.flatnonzero(bottom > bottom[box] + 0.5):
            a = np.maximum(np.floor(self.middle[other] - self.size[other] / 2 - low).astype(int), 0)
            b = np.maximum(np.ceil(self.middle[other] + self.size[other] / 2 - low).astype(int), 0)
            mask[a[1] : b[1], a[0] : b[0]] = 0
        patch = np.ascontiguousarray(self.gray[low[1] : high[1], low[0] : high[0]])
        found = cv2.goodFeaturesToTrack(patch, p.corners, 0.01, 2, mask=mask, blockSize=3)
        if found is None or len(found) < p.least:
            return np.zeros((0, 2))
        return np.asarray(found.reshape(-1, 2) + low, dtype=np.float64)


class KltTracklets:
    """Follows the boxes of one camera back through its last images. State after a frame depends on the frames up to it alone."""

    def __init__(self, camera: Camera, parameters: TrackletParameters | None = None) -> None:
        self.camera, self.parameters = camera, parameters or TrackletParameters()
        self._round = isinstance(camera, Panorama)
        self._past: deque[Frames] = deque(maxlen=self.parameters.l_c)

    def step(self, image: Image | None, detections: Detections) -> tuple[Array, ...]:
        """Take a frame. (m, n) for each of the last frames, the latest first: the log-likelihood ratio that the i-th box then and the j-th box now
        are one person, over two people at most a box's width apart; 0 where the images do not say. Without an image all is forgotten."""
        if image is None:
            self._past.clear()
            return ()
        now = self._frame(image, detections)
        links = tuple(self._worth(then, now, led) for then, led in zip(self._past, self._led(now), strict=True))
        self._past.appendleft(now)
        return links

    def _frame(self, image: Image, detections: Detections) -> Frames:
        """Boxes in pixels of the image at half its size; pixels of images that are scaled are scaled with them."""
        height, width = image.shape[:2]
        gray = cv2.resize(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), (width // 2, height // 2), interpolation=cv2.INTER_AREA)
        scale = np.array([width // 2 / self.camera.width, height // 2 / self.camera.height])
        middle, size = (scale * pixels for pixels in drawn(self.camera, detections))
        turn = np.inf
        if self._round:
            turn, pad = float(width // 2), int(PAD * (width // 2))
            middle[:, 0] += pad
            gray = cv2.copyMakeBorder(gray, 0, 0, pad, pad, cv2.BORDER_WRAP)
        return Frames(np.asarray(gray, dtype=np.uint8), turn, middle, size)

    def _led(self, now: Frames) -> list[Array]:
        """(n, 2) px for each frame of the past: where the corners of the boxes of now lead their middles; NaN where they do not."""
        p, n = self.parameters, len(now.middle)
        found = [now.corners(box, p) for box in range(n)]
        owner = np.repeat(np.arange(n), [len(f) for f in found])
        points = np.concatenate([*found, np.zeros((0, 2))])
        middle, out, image = now.middle.copy(), [], now.gray
        middle[[len(f) == 0 for f in found]] = np.nan
        for then in self._past:
            if len(points):
                start = points.astype(np.float32)
                moved, status, _ = cv2.calcOpticalFlowPyrLK(image, then.gray, start, np.zeros_like(start), winSize=WINDOW, maxLevel=LEVELS)
                keep = np.asarray(status).ravel() > 0
                step, points, owner = (np.asarray(moved) - start)[keep], np.asarray(moved, dtype=np.float64)[keep], owner[keep]
                agreed = np.zeros(len(points), dtype=bool)
                for box in range(n):
                    mine = np.flatnonzero(owner == box)
                    shift, agree = voted(step[mine].astype(np.float64), float(now.size[box, 0]), p)
                    middle[box] += shift
                    agreed[mine[agree]] = True
                points, owner = points[agreed], owner[agreed]
            out.append(middle.copy())
            image = then.gray
        return out

    def _worth(self, then: Frames, now: Frames, led: Array) -> Array:
        """(m, n) log-likelihood ratios of the boxes of `then` for the boxes of `now`, led back to (n, 2) px."""
        p = self.parameters
        away = then.middle[:, None] - led[None]
        if np.isfinite(now.turn):
            away[..., 0] = (away[..., 0] + now.turn / 2) % now.turn - now.turn / 2
        width = (then.size[:, None, 0] + now.size[None, :, 0]) / 2
        square = (away**2).sum(axis=2) / width**2
        # A right box lies where its corners lead, as a normal density has it; another one anywhere within a width.
        right = np.exp(-0.5 * square / p.sigma**2) / (2 * np.pi * p.sigma**2)
        ratio = np.log((1 - p.astray) * right * np.pi + p.astray)
        return np.where(np.isfinite(square), ratio, 0.0)


class TrackOwners:
    """Whose the boxes of the last frames were, a camera each: so what links say of boxes is said of tracks."""

    def __init__(self) -> None:
        self._trees: dict[str, deque[Ints]] = {}

    def links(self, camera: str, tree: Ints, links: tuple[Array, ...], missed: float) -> Array:
        """(t, d): for the tracks of these trees (t,) the link of the box that each had last in this camera; 0 for who had none.

        missed: how often somebody without a box stands before one, and its corners are his: then images say nothing.
        """
        out = np.zeros((len(tree), links[0].shape[1] if links else 0))
        told = np.zeros(len(tree), dtype=bool)
        for link, owner in zip(links, self._trees.get(camera, ()), strict=False):
            for box in np.flatnonzero(owner >= 0):
                mine = (tree == owner[box]) & ~told
                out[mine], told = np.log((1 - missed) * np.exp(link[box]) + missed), told | mine
        return out

    def add(self, camera: str, owner: Ints) -> None:
        """Say whose (n,) the boxes of this frame were, −1 for nobody's."""
        self._trees.setdefault(camera, deque(maxlen=LONGEST)).appendleft(owner)


def voted(steps: Array, width: float, p: TrackletParameters) -> tuple[Array, NDArray[np.bool_]]:
    """How a box (width px) moved (2,) px, by the steps (k, 2) px of its corners, and which of them (k,) moved with it; NaN where too few agree.

    Where fewer than half moved the box stays; else the step wins that most others agree with.
    """
    if len(steps) < p.least:
        return np.full(2, np.nan), np.zeros(len(steps), dtype=bool)
    moved = np.linalg.norm(steps, axis=1) >= p.delta_min
    if 2 * moved.sum() < len(steps):
        return np.zeros(2), ~moved
    near = np.linalg.norm(steps[:, None] - steps[None], axis=2) < p.omega * width
    near &= moved[None, :] & moved[:, None]
    agree = near[int(near.sum(axis=1).argmax())]
    if agree.sum() < p.least:
        return np.full(2, np.nan), np.zeros(len(steps), dtype=bool)
    return np.asarray(np.median(steps[agree], axis=0)), agree
