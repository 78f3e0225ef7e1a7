"""Boxes at the local maxima of the scores that the network gives, before they are calibrated and before suppression."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from tracker.geometry import Array, Ints, Mask, set_array
from tracker.person_detector.network import STRIDE, Maps
from tracker.person_detector.pixels import Level

MOST = 1000
"""Peaks of a level, the surest."""
LONGEST_EDGE = 8.0
"""Logarithm of the longest distance to an edge, px."""


@dataclass(frozen=True, eq=False)
class Peaks:
    """box (n, 4): left, top, width, height px of the picture. logit (n,): of the scores.

    sigma (n, 4) px: standard deviations of left, top, right and bottom, or None where the network has none.
    """

    box: Array
    logit: Array
    sigma: Array | None = None

    def __post_init__(self) -> None:
        n = len(self.box)
        set_array(self, "box", (n, 4))
        set_array(self, "logit", (n,))
        if self.sigma is not None:
            set_array(self, "sigma", (n, 4))

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

    def select(self, rows: Mask | Ints) -> Peaks:
        """The peaks in `rows`."""
        return Peaks(self.box[rows], self.logit[rows], None if self.sigma is None else self.sigma[rows])

    @staticmethod
    def joined(parts: list[Peaks]) -> Peaks:
        """The peaks of one or more parts, one after the other."""
        sigmas = [part.sigma for part in parts if part.sigma is not None]
        sigma = np.concatenate(sigmas) if len(sigmas) == len(parts) else None
        return Peaks(np.concatenate([part.box for part in parts]), np.concatenate([part.logit for part in parts]), sigma)


def peaks_of(maps: Maps, level: Level, least_logit: float) -> Peaks:
    """The peaks of a level with logits of at least `least_logit`."""
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
    sigma = None
    if "spread" in maps:
        # The standard deviation of a Laplace distribution is its scale times √2.
        sigma = np.sqrt(2) * np.exp(np.minimum(maps["spread"][:, rows, columns].astype(np.float64).T, 0.0)) * box[:, 3:]
    good = np.isfinite(box).all(axis=1) & (box[:, 2:] > 0).all(axis=1)
    return Peaks(box, logits, sigma).select(np.asarray(good))
