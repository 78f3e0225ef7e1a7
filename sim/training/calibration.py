"""Calibration of the scores on rendered images: the overlap of the suppression, and a monotone map from logits to probabilities.

The map is an isotonic regression (Barlow et al. 1972) of bins with equal numbers of found bodies.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import isotonic_regression

from sim.training.evaluation import FoundImage, Range, judged
from sim.training.targets import LEAST_VISIBLE
from tracker.geometry import Array, Mask
from tracker.metrics.box_detection import average_precision

NMS_IOUS = (0.45, 0.5, 0.55, 0.6, 0.65, 0.7)
"""Overlaps that are tried."""
BINS, LEAST_IN_BIN = 24, 8
"""Number of bins, and least number of found bodies in one."""
MIN_SCORE = 0.05
"""Probability below which a box is not worth its name."""


@dataclass(frozen=True)
class Calibration:
    """nms_iou: of the suppression. corners: pairs of logit and probability, both growing."""

    nms_iou: float
    corners: tuple[tuple[float, float], ...]


def calibrate(images: list[FoundImage]) -> Calibration:
    """The calibration from images that were not trained on."""
    wanted = Range((12.0, 512.0), (LEAST_VISIBLE, 2.0))
    scores = {iou: np.nan_to_num(average_precision(*judged(images, wanted, iou))) for iou in NMS_IOUS}
    best = max(scores, key=lambda iou: scores[iou])
    logits, hits, _ = judged(images, wanted, best)
    return Calibration(best, corners(logits, hits))


def corners(logits: Array, hits: Mask) -> tuple[tuple[float, float], ...]:
    """Pairs of logit and probability of boxes with logits (n,) that are bodies or not (n,); the line from 0 to 1 where there are too few boxes."""
    bins = min(BINS, int(hits.sum()) // LEAST_IN_BIN)
    if bins < 2:
        return ((-10.0, 0.0), (10.0, 1.0))
    # Bins of equal numbers of bodies: most boxes are no bodies, and have the lowest logits.
    which = np.searchsorted(np.quantile(logits[hits], np.arange(1, bins) / bins), logits, side="right")
    parts = [part for k in range(bins) if len(part := np.flatnonzero(which == k))]
    middle, share = (np.array([values[part].mean() for part in parts]) for values in (logits, hits.astype(np.float64)))
    risen = np.clip(isotonic_regression(share, weights=np.array([len(part) for part in parts], dtype=np.float64)).x, 0.0, 1.0)
    growing = np.append(True, np.diff(middle) > 1e-6)
    return tuple((round(float(x), 4), round(float(p), 4)) for x, p in zip(middle[growing], risen[growing], strict=True))
