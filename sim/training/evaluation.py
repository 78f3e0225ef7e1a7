"""Scores of the detector on rendered images: average precision at an IoU of 0.5 by kind of image, by height, visible share and world.

Bodies outside of the asked range are ignored, as are boxes on them (as in COCO's evaluation, Lin et al. 2014).
The calibration is the overlap of the suppression, and a monotone map from logits to probabilities.
The map is an isotonic regression (Barlow et al. 1972) of bins with equal numbers of found bodies.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.optimize import isotonic_regression

from sim.training.augmentation import cut_off, visible_parts
from sim.training.scene_rendering import ImageSet
from sim.training.targets import HIDDEN, LEAST_VISIBLE
from tracker.geometry import Array, Mask
from tracker.geometry.cameras import Panorama
from tracker.geometry.image_boxes import edges_of
from tracker.metrics.box_detection import IOU, NOBODY, WantedBodies, average_precision, box_overlaps, match_by_score
from tracker.metrics.box_scores import VISIBLE
from tracker.person_detector.detector import PersonDetector, within
from tracker.person_detector.found_boxes import FoundBoxes, kept_rows
from tracker.person_detector.search_levels import search_levels
from worlds.scenes import meeting_room

LEAST_LOGIT = -4.5
"""Least logit of a box that is evaluated."""
SEEN = 0.5, np.inf
"""Visible shares of the bodies of the main figure."""
HEIGHTS = (20.0, 256.0)
"""px: heights of the bodies of the main figure."""
HEIGHTS_INDOORS = (20.0, 577.0)
"""px: the same in rooms, where people are near."""
ROOM = "room "
"""How the titles of parts of the figures begin that are of rooms."""
HEIGHT_BINS = (8.0, 16.0, 32.0, 64.0, 128.0, 256.0, 512.0)


@dataclass(frozen=True, eq=False)
class FoundImage:
    """What was found in one image before suppression, and its bodies: boxes (n, 4) px, visible (n,), cut (n,).

    period: width of a panorama, or None. parts (n, 4) px: of `visible_parts`.
    """

    found: FoundBoxes
    boxes: Array
    visible: Array
    cut: Mask
    world: str
    period: float | None
    parts: Array

    @property
    def heights(self) -> Array:
        """Heights (n,) of the bodies, px."""
        return self.boxes[:, 3] - self.boxes[:, 1]

    def suppressed(self, nms_iou: float) -> FoundBoxes:
        """One box for each body, with its logit, the highest first."""
        return self.found.select(kept_rows(self.found.box, self.found.score, nms_iou, self.period))


def found_images(detector: PersonDetector, sets: Iterable[tuple[str, ImageSet]], wraps: bool) -> list[FoundImage]:
    """What is found in all images of some sets, each with the name of its world. wraps: whether they are panoramas.

    People cut by the border of an image count only in rooms; true and found boxes end at the border.
    """
    out = []
    for world, images in sets:
        height, width = images.instances.shape[1:]
        levels = search_levels((height, width), Panorama(width, height) if wraps else None)
        for index in range(len(images.colour)):
            mine = images.image == index
            cut = cut_off(images.boxes[mine], width, height, wraps) & (world != meeting_room.NAME)
            image = np.ascontiguousarray(images.colour[index])
            found = within(detector.peaks(image, levels, wraps, LEAST_LOGIT), image, wraps)
            parts = visible_parts(images.instances[index], images.person[mine], images.boxes[mine], wraps)
            out.append(FoundImage(found, images.boxes[mine], images.visible[mine], cut, world, float(width) if wraps else None, parts))
    return out


def judged(images: list[FoundImage], wanted: WantedBodies, nms_iou: float, part: bool = False) -> tuple[Array, Mask, int]:
    """Logits (k,) of boxes after suppression, whether each is a body, and the number of bodies that had to be found.

    part: the boxes of the visible parts are compared in place of those of whole bodies.
    """
    logits, hits, count = [], [], 0
    for image in images:
        found = image.suppressed(nms_iou)
        edges, there = edges_of(found.visible if part else found.box), image.visible >= HIDDEN
        boxes, visible = (image.parts if part else image.boxes)[there], image.visible[there]
        good = ~image.cut[there] & wanted.of_this_height(image.boxes[there]) & (visible >= wanted.visible[0]) & (visible < wanted.visible[1])
        count += int(good.sum())
        # Ignored bodies take any number of boxes, as crowds in COCO do.
        body = match_by_score(box_overlaps(edges, boxes, image.period), good, np.array([IOU]), ~good)[0]
        hit = np.append(good, False)[body]
        counted = hit | ((body == NOBODY) & wanted.of_this_height(edges_of(found.box)))
        logits.append(found.score[counted])
        hits.append(hit[counted])
    return np.concatenate(logits or [np.zeros(0)]), np.concatenate(hits or [np.zeros(0, bool)]), count


def heights_of(title: str) -> tuple[float, float]:
    """The heights, px, of the bodies of the main figure of a part."""
    return HEIGHTS_INDOORS if title.startswith(ROOM) else HEIGHTS


def figures(images: list[FoundImage], nms_iou: float, heights: tuple[float, float] = HEIGHTS) -> dict[str, float | int]:
    """Average precision by name: all, by height, by visible share and by world; and the number of bodies of the first."""
    logits, hits, count = judged(images, WantedBodies(heights, SEEN), nms_iou)
    out: dict[str, float | int] = {"bodies": count, "ap50": average_precision(logits, hits, count)}
    for low, high in pairwise(HEIGHT_BINS):
        out[f"ap50, {low:.0f}-{high:.0f} px"] = average_precision(*judged(images, WantedBodies((low, high), SEEN), nms_iou))
    for low, high in pairwise(VISIBLE):
        out[f"ap50, seen {low:g}-{min(high, 1):g}"] = average_precision(*judged(images, WantedBodies(heights, (low, high)), nms_iou))
    out["ap50 of visible parts"] = average_precision(*judged(images, WantedBodies(heights, (LEAST_VISIBLE, np.inf)), nms_iou, True))
    for world in sorted({image.world for image in images}):
        own = [image for image in images if image.world == world]
        out[f"ap50, {world}"] = average_precision(*judged(own, WantedBodies(heights, SEEN), nms_iou))
    return {name: round(value, 4) for name, value in out.items()}


def feet_errors(images: list[FoundImage], nms_iou: float, heights: tuple[float, float] = HEIGHTS) -> Array:
    """Errors (k,) of the lower edge of found bodies, as a share of their height; positive is too low."""
    errors = []
    for image in images:
        kept = image.suppressed(nms_iou)
        found = edges_of(kept.box[kept.score > 0.0])
        good = np.flatnonzero((image.visible >= SEEN[0]) & ~image.cut & (image.heights >= heights[0]) & (image.heights < heights[1]))
        if not len(good) or not len(found):
            continue
        iou = box_overlaps(found, image.boxes[good], image.period)
        best, which = iou.max(axis=0), iou.argmax(axis=0)
        near = best >= IOU
        errors.append((found[which[near], 3] - image.boxes[good[near], 3]) / image.heights[good[near]])
    return np.concatenate(errors or [np.zeros(0)])


NMS_IOUS = (0.45, 0.5, 0.55, 0.6, 0.65, 0.7)
"""IoU thresholds of the suppression that are tried."""
BINS, LEAST_IN_BIN = 24, 8
"""Number of bins, and least number of found bodies in one."""
MIN_SCORE = 0.05
"""Probability below which the detector drops a box."""


@dataclass(frozen=True)
class Calibration:
    """nms_iou: of the suppression. corners: pairs of logit and probability, both growing."""

    nms_iou: float
    corners: tuple[tuple[float, float], ...]


def calibrate(images: list[FoundImage]) -> Calibration:
    """The calibration from images that were not used for training."""
    wanted = WantedBodies((12.0, 512.0), (LEAST_VISIBLE, np.inf))
    scores = {iou: np.nan_to_num(average_precision(*judged(images, wanted, iou))) for iou in NMS_IOUS}
    best = max(scores, key=lambda iou: scores[iou])
    logits, hits, _ = judged(images, wanted, best)
    return Calibration(best, corners(logits, hits))


def corners(logits: Array, hits: Mask) -> tuple[tuple[float, float], ...]:
    """Pairs of logit and probability, from boxes with logits (n,) and hits (n,), True for bodies; a line from 0 to 1 for too few hits."""
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
