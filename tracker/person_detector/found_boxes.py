"""Boxes of people in an image: from the maps of scores and edges of the network, with non-maximum suppression."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from tracker.geometry import Array, Ints, Mask, set_array
from tracker.geometry.image_boxes import box_overlaps
from tracker.person_detector.network import STRIDE, Maps
from tracker.person_detector.pixels import Level

FEET = 0.15
"""Share of a box, at its lower end, that counts as the area of its feet."""
SAME_FEET = 0.45
"""Two boxes whose areas of the feet overlap by more than this IoU are one person from SOFTER times the usual IoU on."""
SOFTER = 0.8
MOST = 1000
"""Most peaks of a level, those with the highest scores."""
LEAST_SIDE = 0.05
"""Least side of the visible part of a body, a share of that of its box."""
LONGEST_EDGE = 8.0
"""Largest logarithm of the distance to an edge in px."""


@dataclass(frozen=True, eq=False)
class FoundBoxes:
    """Boxes of whole people in an image, the highest score first.

    box (n, 4): left, top, width, height px. In an image that wraps, left is in [0, W) and left + width may pass W.
    score (n,): the probability that the box is a person at an IoU of 0.5; before calibration its logit, as the network gives it.
    sigma (n, 4) px: standard deviations of left, top, right and bottom, or None where the network has none.
    hidden (n, 4): shares of the box beyond the visible part of the body at left, top, right and bottom, or None likewise.
    """

    box: Array
    score: Array
    sigma: Array | None = None
    hidden: Array | None = None

    def __post_init__(self) -> None:
        n = len(self.box)
        set_array(self, "box", (n, 4))
        set_array(self, "score", (n,))
        for name in ("sigma", "hidden"):
            if getattr(self, name) is not None:
                set_array(self, name, (n, 4))

    def __len__(self) -> int:
        return len(self.box)

    @property
    def height(self) -> Array:
        """Heights (n,) of the boxes, px."""
        return self.box[:, 3]

    @property
    def middle(self) -> Array:
        """Middles (n, 2) of the boxes, px."""
        return np.asarray(self.box[:, :2] + self.box[:, 2:] / 2)

    @property
    def visible(self) -> Array:
        """Left, top, width, height (n, 4) px of the visible part of each body, and its share (n,) of the whole box as the last column (n, 5)."""
        hidden = np.zeros(self.box.shape) if self.hidden is None else self.hidden
        start, size = hidden[:, :2], np.maximum(1 - hidden[:, :2] - hidden[:, 2:], LEAST_SIDE)
        return np.column_stack([self.box[:, :2] + start * self.box[:, 2:], size * self.box[:, 2:], np.prod(size, axis=1)])

    def select(self, rows: Mask | Ints) -> FoundBoxes:
        """The boxes in `rows`."""
        sigma, hidden = (None if values is None else values[rows] for values in (self.sigma, self.hidden))
        return FoundBoxes(self.box[rows], self.score[rows], sigma, hidden)

    @staticmethod
    def joined(parts: list[FoundBoxes]) -> FoundBoxes:
        """The boxes of one or more parts, one after the other."""
        sigma, hidden = (_rows([getattr(part, name) for part in parts]) for name in ("sigma", "hidden"))
        return FoundBoxes(np.concatenate([part.box for part in parts]), np.concatenate([part.score for part in parts]), sigma, hidden)


def _rows(parts: list[Array | None]) -> Array | None:
    """The rows of all parts; None if a part has none."""
    there = [part for part in parts if part is not None]
    return np.concatenate(there) if len(there) == len(parts) else None


def peaks_of(maps: Maps, level: Level, least_logit: float) -> FoundBoxes:
    """The boxes at the local maxima of the scores of a level, with logits of at least `least_logit`."""
    scores = maps["scores"][0]
    highest = scores >= cv2.dilate(scores, np.ones((3, 3), np.uint8))
    rows, columns = np.nonzero(highest & (scores >= least_logit) & np.isfinite(scores))
    logits = scores[rows, columns].astype(np.float64)
    first = np.lexsort((columns, rows, -logits))[:MOST]
    rows, columns, logits = rows[first], columns[first], logits[first]
    edges = np.exp(np.minimum(maps["edges"][:, rows, columns].astype(np.float64), LONGEST_EDGE)).T
    centre = (np.stack([columns, rows], axis=1) + 0.5) * STRIDE - level.origin
    left_top, right_bottom = centre - edges[:, :2], centre + edges[:, 2:]
    box = np.concatenate([left_top, right_bottom - left_top], axis=1) * level.scale
    sigma = hidden = None
    if "hidden" in maps:
        hidden = 1 / (1 + np.exp(-maps["hidden"][:, rows, columns].astype(np.float64).T))
    if "spread" in maps:
        # The standard deviation of a Laplace distribution is its scale times √2.
        sigma = np.sqrt(2) * np.exp(np.minimum(maps["spread"][:, rows, columns].astype(np.float64).T, 0.0)) * box[:, 3:]
    good = np.isfinite(box).all(axis=1) & (box[:, 2:] > 0).all(axis=1)
    return FoundBoxes(box, logits, sigma, hidden).select(np.asarray(good))


def hidden_shares(boxes: Array, seen: Array) -> Array:
    """Shares (n, 4) of boxes beyond their visible parts at left, top, right and bottom. boxes, seen (n, 4): left, top, right, bottom px."""
    size = np.maximum(np.tile(boxes[:, 2:] - boxes[:, :2], 2), 1e-9)
    return np.clip((seen - boxes) * np.array([1.0, 1.0, -1.0, -1.0]) / size, 0.0, 1.0)


def one_for_each(found: FoundBoxes, iou: float, period: float | None = None) -> FoundBoxes:
    """Non-maximum suppression: of boxes that are one person, the one with the highest score.

    Two boxes are one person if their IoU is more than `iou`, or a little less if the areas of the feet overlap as well.
    People who stand behind each other have feet at different heights of the image. period: width of an image that wraps, px.
    """
    return found.select(kept_rows(found.box, found.score, iou, period))


def kept_rows(boxes: Array, score: Array, iou: float, period: float | None) -> Ints:
    """Rows of boxes (n, 4) with scores (n,) that `one_for_each` keeps, the highest score first."""
    order = np.lexsort((boxes[:, 0], boxes[:, 1], -score))
    left, top, width, height = boxes[order].T
    box = np.column_stack([left, top, left + width, top + height])
    feet = np.column_stack([left, top + (1 - FEET) * height, left + width, top + height])
    alive, kept = np.ones(len(box), dtype=bool), []
    for k in range(len(box)):
        if not alive[k]:
            continue
        kept.append(k)
        overlap, stand = (box_overlaps(edges[k : k + 1], edges[k + 1 :], period)[0] for edges in (box, feet))
        same = (overlap > iou) | ((overlap > SOFTER * iou) & (stand > SAME_FEET))
        alive[k + 1 :] &= ~same
    return np.asarray(order[np.array(kept, dtype=np.int64)])
