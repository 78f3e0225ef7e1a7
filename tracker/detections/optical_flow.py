"""Tracklets by optical flow: boxes of a frame linked to boxes of the last frames by corners that are tracked back through the images.

Corners (Shi and Tomasi 1994) of a box are tracked by pyramidal Lucas-Kanade (Bouguet 2001). The shift of a box from frame to frame is a vote of its
corners. A link is a log-likelihood ratio, so that it adds to the likelihoods of places on the ground.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from tracker.detections.boxes import approximate_pixel_boxes
from tracker.geometry import Array, Image, Ints
from tracker.geometry.cameras import Camera
from tracker.types import Detections

Gray = NDArray[np.uint8]

WINDOW, LEVELS = (15, 15), 3
"""Window in px, and pyramid levels, of Lucas-Kanade."""
MAX_FRAMES = 15
"""Greatest number of frames that corners are tracked back."""
MAX_CORNERS, MIN_CORNERS = 100, 4
"""Greatest and least number of corners of a box; the least also of those that agree."""
INNER_WIDTH = 0.7
"""Share of a box's width, about its middle, where corners are detected."""
SIGMA, OUTLIER_SHARE = 0.25, 0.05
"""Standard deviation of the middle of the right box from its prediction, as a share of a box's width; boxes whose corners follow something else."""
PAD = 1 / 8
"""Share of a panorama's width that is repeated beyond either side of its seam."""


@dataclass(frozen=True)
class TrackletParameters:
    """Names are those of Yoo et al. 2017 where it has them; pixels are those of the image at half its size."""

    l_c: int = 4  # frames that corners are tracked back
    delta_min: float = 0.05  # px, a corner that moves less is static
    omega: float = 0.3  # share of a box's width: two corners agree if their steps differ by less

    def __post_init__(self) -> None:
        if not 1 <= self.l_c <= MAX_FRAMES:
            raise ValueError(f"l_c is {self.l_c}, needs 1 to {MAX_FRAMES}")
        for name in ("delta_min", "omega"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name} is {getattr(self, name)}, needs more than 0")


@dataclass(frozen=True, eq=False)
class Frame:
    """A past frame: the grey image at half its size, continued beyond a panorama's seam, and its boxes.

    turn: px of a full turn of a panorama, inf for other cameras.
    middle and size (n, 2) px: of the boxes; the middle is NaN for a box outside the image.
    """

    gray: Gray
    turn: float
    middle: Array
    size: Array

    def corners(self, box: int) -> Array:
        """Corners (k, 2) px of a box outside nearer boxes, which end lower; none where there are too few."""
        if not np.isfinite(self.middle[box]).all():
            return np.zeros((0, 2))
        half = self.size[box] / 2 * [INNER_WIDTH, 0.9]
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
        found = cv2.goodFeaturesToTrack(patch, MAX_CORNERS, 0.01, 2, mask=mask, blockSize=3)
        if found is None or len(found) < MIN_CORNERS:
            return np.zeros((0, 2))
        return np.asarray(found.reshape(-1, 2) + low, dtype=np.float64)


class KltTracklets:
    """Links the boxes of one camera to those of its last frames; causal: its state depends on the frames so far."""

    def __init__(self, camera: Camera, parameters: TrackletParameters | None = None) -> None:
        self.camera, self.parameters = camera, parameters or TrackletParameters()
        self._past: deque[Frame] = deque(maxlen=self.parameters.l_c)

    def step(self, image: Image | None, detections: Detections) -> tuple[Array, ...]:
        """Process a frame. Returns its links to each of the last frames, the latest first.

        A link (m, n) holds log-likelihood ratios of box i of the old frame and box j of this one: one person over two people within a box's width. It
        is 0 where the images are no evidence. A frame without an image clears the state.
        """
        if image is None:
            self._past.clear()
            return ()
        now = self._frame(image, detections)
        links = tuple(self._log_ratios(then, now, traced) for then, traced in zip(self._past, self._trace_back(now), strict=True))
        self._past.appendleft(now)
        return links

    def _frame(self, image: Image, detections: Detections) -> Frame:
        """The image and the boxes in pixels at half the image's size; an image may be smaller or larger than its camera's model."""
        height, width = image.shape[:2]
        gray = cv2.resize(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), (width // 2, height // 2), interpolation=cv2.INTER_AREA)
        scale = np.array([width // 2 / self.camera.width, height // 2 / self.camera.height])
        middle, size = (scale * pixels for pixels in approximate_pixel_boxes(self.camera, detections))
        turn = np.inf
        if self.camera.wraps:
            turn, pad = float(width // 2), int(PAD * (width // 2))
            middle[:, 0] += pad
            gray = cv2.copyMakeBorder(gray, 0, 0, pad, pad, cv2.BORDER_WRAP)
        return Frame(np.asarray(gray, dtype=np.uint8), turn, middle, size)

    def _trace_back(self, now: Frame) -> list[Array]:
        """Middles (n, 2) px of the boxes of `now` in each past frame, as their corners predict them; NaN where they do not."""
        p, n = self.parameters, len(now.middle)
        found = [now.corners(box) for box in range(n)]
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
                    shift, agree = vote_shift(step[mine].astype(np.float64), float(now.size[box, 0]), p)
                    middle[box] += shift
                    agreed[mine[agree]] = True
                points, owner = points[agreed], owner[agreed]
            out.append(middle.copy())
            image = then.gray
        return out

    def _log_ratios(self, then: Frame, now: Frame, traced: Array) -> Array:
        """Log-likelihood ratios (m, n) of the boxes of `then` for the boxes of `now`, whose middles are traced back to (n, 2) px."""
        offset = then.middle[:, None] - traced[None]
        if np.isfinite(now.turn):
            offset[..., 0] = (offset[..., 0] + now.turn / 2) % now.turn - now.turn / 2
        width = (then.size[:, None, 0] + now.size[None, :, 0]) / 2
        square = (offset**2).sum(axis=2) / width**2
        # The right box is normally distributed about the prediction; another one is uniform within a width.
        right = np.exp(-0.5 * square / SIGMA**2) / (2 * np.pi * SIGMA**2)
        ratio = np.log((1 - OUTLIER_SHARE) * right * np.pi + OUTLIER_SHARE)
        return np.where(np.isfinite(square), ratio, 0.0)


class TrackOwners:
    """The tracks that own the boxes of each camera's last frames. They turn links of boxes into links of tracks."""

    def __init__(self) -> None:
        self._trees: dict[str, deque[Ints]] = {}

    def links(self, camera: str, tree: Ints, links: tuple[Array, ...], missed: float) -> Array:
        """Log-likelihood ratios (t, d) of the boxes for tracks of ids `tree` (t,): the link of each track's last box in the camera, 0 without one.

        missed: probability that a box's corners belong to an undetected person in front of it; the link is then no evidence.
        """
        out = np.zeros((len(tree), links[0].shape[1] if links else 0))
        linked = np.zeros(len(tree), dtype=bool)
        for link, owner in zip(links, self._trees.get(camera, ()), strict=False):
            for box in np.flatnonzero(owner >= 0):
                mine = (tree == owner[box]) & ~linked
                out[mine], linked = np.log((1 - missed) * np.exp(link[box]) + missed), linked | mine
        return out

    def add(self, camera: str, owner: Ints) -> None:
        """Add a frame: the track id (n,) of each of its boxes, −1 for none."""
        self._trees.setdefault(camera, deque(maxlen=MAX_FRAMES)).appendleft(owner)


def vote_shift(steps: Array, width: float, p: TrackletParameters) -> tuple[Array, NDArray[np.bool_]]:
    """Shift (2,) px of a box by a vote of its corners, and which corners (k,) agree; NaN where too few do.

    steps (k, 2) px: of the corners; width px: of the box.

    Where fewer than half of the corners move, the shift is 0. Else it is the median of the largest set that agrees with one of its steps.
    """
    if len(steps) < MIN_CORNERS:
        return np.full(2, np.nan), np.zeros(len(steps), dtype=bool)
    moved = np.linalg.norm(steps, axis=1) >= p.delta_min
    if 2 * moved.sum() < len(steps):
        return np.zeros(2), ~moved
    near = np.linalg.norm(steps[:, None] - steps[None], axis=2) < p.omega * width
    near &= moved[None, :] & moved[:, None]
    agree = near[int(near.sum(axis=1).argmax())]
    if agree.sum() < MIN_CORNERS:
        return np.full(2, np.nan), np.zeros(len(steps), dtype=bool)
    return np.asarray(np.median(steps[agree], axis=0)), agree
