"""Scores of a detector's boxes in images: average precision, MODA, MODP, recall, and the reliability of the scores.

* Average precision is that of pycocotools (Lin et al. 2014): boxes are matched by descending score, and precision is read at 101 recalls.
  Images are not limited to 100 boxes.
* MODA and MODP are those of CLEAR (Kasturi et al. 2009), at one threshold of the score.
  Each image is matched alone: the most pairs, at the largest sum of IoU.
* A body that does not have to be found is ignored, together with a box that matches it and no other body.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tracker.geometry import Array, Ints, Mask, set_array
from tracker.geometry.image_boxes import box_overlaps as box_overlaps
from tracker.metrics.matching import best_pairs

IOU = 0.5
"""Least IoU of a box with the body that it shows."""
IOUS = np.linspace(0.5, 0.95, 10)
"""Thresholds of IoU of COCO's main figure, which is the mean over them."""
RECALLS = np.linspace(0.0, 1.0, 101)
NOBODY = -1
BINS = 10
"""Number of bins of equal width, for the reliability of the scores."""
TRIED = 50
"""Number of thresholds of the score that are tried for the best MODA."""
EPSILON = 1e-10


@dataclass(frozen=True, eq=False)
class ImageBoxes:
    """True and found boxes of one image.

    truth (n, 4), found (k, 4): left, top, right, bottom px. score (k,): any finite number.
    visible (n,): share of each body that is seen, NaN where unknown.
    counts (n,): False for bodies that are ignored. judged (k,): False for boxes where truth may be missing: they are no false positives.
    truth_feet (n, 2), found_feet (k, 2) m: places on the ground, NaN where unknown. period: width of an image that wraps, px.
    world, camera: what scores are grouped by. frame: of the source, from 0, −1 where it has no images.
    Raises ValueError for other shapes, sizes below 0 and scores that are not finite.
    """

    truth: Array
    found: Array
    score: Array
    visible: Array
    counts: Mask
    judged: Mask
    truth_feet: Array
    found_feet: Array
    period: float | None = None
    world: str = ""
    camera: str = ""
    frame: int = -1

    def __post_init__(self) -> None:
        n, k = len(self.truth), len(self.found)
        shapes = {"truth": (n, 4), "found": (k, 4), "score": (k,), "truth_feet": (n, 2), "found_feet": (k, 2), "visible": (n,)}
        for name, shape in shapes.items():
            may_miss = name in ("visible", "truth_feet", "found_feet")
            values = np.asarray(getattr(self, name), dtype=np.float64).reshape(shape)
            if not may_miss and not np.isfinite(values).all():
                raise ValueError(f"{name} has a number that is not finite")
            object.__setattr__(self, name, values)
        for name in ("truth", "found"):
            boxes = getattr(self, name)
            if (boxes[:, 2:] < boxes[:, :2]).any():
                raise ValueError(f"{name} has a box with a negative width or height")
        if self.counts.shape != (n,) or self.judged.shape != (k,):
            raise ValueError(f"counts and judged have shapes {self.counts.shape} and {self.judged.shape}, needs ({n},) and ({k},)")

    @staticmethod
    def of(truth: Array, found: Array, score: Array) -> ImageBoxes:
        """An image of which only boxes are known; all bodies count."""
        n, k = len(truth), len(found)
        unknown = np.full((n, 2), np.nan), np.full((k, 2), np.nan)
        return ImageBoxes(truth, found, score, np.full(n, np.nan), np.ones(n, dtype=np.bool_), np.ones(k, dtype=np.bool_), *unknown)


@dataclass(frozen=True)
class WantedBodies:
    """The bodies that have to be found: heights px and visible shares, lower bounds included, upper bounds not.

    An unknown share is in bounds.
    """

    heights: tuple[float, float] = (0.0, np.inf)
    visible: tuple[float, float] = (0.0, np.inf)

    def of(self, image: ImageBoxes) -> Mask:
        """Mask (n,) of the bodies of an image that have to be found."""
        seen = np.isnan(image.visible) | ((image.visible >= self.visible[0]) & (image.visible < self.visible[1]))
        return np.asarray(image.counts & self.of_this_height(image.truth) & seen)

    def of_this_height(self, boxes: Array) -> Mask:
        """Mask (n,) of the boxes (n, 4), left, top, right, bottom px, whose height is in bounds."""
        height = boxes[:, 3] - boxes[:, 1]
        return np.asarray((height >= self.heights[0]) & (height < self.heights[1]))


@dataclass(frozen=True, eq=False)
class JudgedBoxes:
    """Boxes of some images that count: score (k,), hit (k,) whether each is a body, image (k,) its index. bodies (images,): to be found in each."""

    score: Array
    hit: Mask
    image: Ints
    bodies: Array

    def __post_init__(self) -> None:
        set_array(self, "score", (len(self.hit),))
        set_array(self, "bodies", (None,))

    def average_precision(self, weight: Array | None = None) -> float:
        """Average precision; NaN without bodies. weight (images,): how often each image counts."""
        if weight is None:
            return average_precision(self.score, self.hit, float(self.bodies.sum()))
        return average_precision(self.score, self.hit, float(weight @ self.bodies), weight[self.image])


def match_by_score(iou: Array, counted: Mask, thresholds: Array, absorbs: Mask | None = None) -> Ints:
    """The body of each box at each threshold of IoU, (thresholds, boxes), NOBODY for none, by the rule of pycocotools.

    iou (boxes, bodies), by descending score of the box. A box takes the free body with the largest IoU; at equal IoU the last one.
    Counted bodies take precedence. absorbs (bodies,): those that take any number of boxes, as crowds in COCO do.
    """
    bound = np.minimum(np.asarray(thresholds, dtype=np.float64), 1 - EPSILON)[:, None]
    count, bodies = iou.shape
    out = np.full((len(bound), count), NOBODY)
    if not bodies:
        return out
    free, level = np.ones((len(bound), bodies), dtype=bool), np.arange(len(bound))
    shared = np.zeros(bodies, dtype=bool) if absorbs is None else absorbs
    for box in np.flatnonzero(iou.max(axis=1) >= bound.min()).tolist():
        possible = (iou[box] >= bound) & (free | shared)
        first = possible & counted
        chosen = np.where(first.any(axis=1, keepdims=True), first, possible)
        value = np.where(chosen, iou[box], -1.0)
        best = bodies - 1 - np.argmax(value[:, ::-1], axis=1)
        matched = np.flatnonzero(chosen[level, best])
        out[matched, box] = best[matched]
        free[matched, best[matched]] = False
    return out


def average_precision(score: Array, hit: Mask, count: float, weight: Array | None = None) -> float:
    """Mean over 101 recalls of the best precision at that recall or a higher one; NaN without bodies.

    score, hit (n,): of boxes. count: bodies that had to be found. weight (n,): how often each box counts, None for once.
    """
    if not count > 0:
        return float("nan")
    order = np.argsort(-score, kind="stable")
    each = np.ones(len(order)) if weight is None else weight[order]
    right, boxes = np.cumsum(each * hit[order]), np.cumsum(each)
    precision, recall = right / np.maximum(boxes, EPSILON), right / count
    best = np.maximum.accumulate(precision[::-1])[::-1]
    at = np.searchsorted(recall, RECALLS)
    return float(np.where(at < len(best), np.append(best, 0.0)[np.minimum(at, len(best))], 0.0).mean())


def judge(images: Sequence[ImageBoxes], wanted: WantedBodies | None = None, thresholds: Array | None = None) -> list[JudgedBoxes]:
    """The boxes of images that count, at each threshold of IoU (IOU alone by default).

    Boxes on ignored bodies do not count. A box on no body counts only if it is judged and its height is in the bounds of `wanted` (as in COCO).
    """
    wanted = wanted or WantedBodies()
    levels = np.array([IOU]) if thresholds is None else np.asarray(thresholds)
    scores, hits, places = [[np.zeros(0)] for _ in levels], [[np.zeros(0, bool)] for _ in levels], [[np.zeros(0, int)] for _ in levels]
    bodies = np.zeros(len(images))
    for index, image in enumerate(images):
        counted, order = wanted.of(image), np.argsort(-image.score, kind="stable")
        bodies[index] = counted.sum()
        found = image.found[order]
        body = match_by_score(box_overlaps(found, image.truth, image.period), counted, levels)
        hit = np.append(counted, False)[body]
        kept = hit | ((body == NOBODY) & image.judged[order] & wanted.of_this_height(found))
        for k in range(len(levels)):
            scores[k].append(image.score[order][kept[k]])
            hits[k].append(hit[k][kept[k]])
            places[k].append(np.full(int(kept[k].sum()), index))
    return [JudgedBoxes(np.concatenate(s), np.concatenate(h), np.concatenate(p), bodies) for s, h, p in zip(scores, hits, places, strict=True)]


@dataclass(frozen=True, eq=False)
class BoxCounts:
    """Counts of each image (images,) at one threshold of the score: bodies, boxes that count, pairs, and the sum of the pairs' IoU."""

    bodies: Array
    boxes: Array
    matches: Array
    overlap: Array

    def moda(self, weight: Array | None = None) -> float:
        """1 − (misses + false positives) / bodies; NaN without bodies. weight (images,): how often each image counts."""
        each = np.ones(len(self.bodies)) if weight is None else weight
        return _ratio(float(each @ (2 * self.matches - self.boxes)), float(each @ self.bodies))

    def modp(self, weight: Array | None = None) -> float:
        """Mean IoU of the pairs."""
        each = np.ones(len(self.bodies)) if weight is None else weight
        return _ratio(float(each @ self.overlap), float(each @ self.matches))

    @property
    def modp_by_image(self) -> float:
        """N-MODP of the paper: the mean over images of the mean IoU of their pairs, 0 for an image without pairs."""
        return float(np.mean(self.overlap / np.maximum(self.matches, 1))) if len(self.bodies) else float("nan")

    @property
    def precision(self) -> float:
        return _ratio(float(self.matches.sum()), float(self.boxes.sum()))

    @property
    def recall(self) -> float:
        return _ratio(float(self.matches.sum()), float(self.bodies.sum()))


def _ratio(above: float, below: float) -> float:
    return above / below if below else float("nan")


def count_boxes(images: Sequence[ImageBoxes], least_score: float, wanted: WantedBodies | None = None) -> BoxCounts:
    """Match the boxes with a score of `least_score` or more, image by image. Bodies that count are matched first; see `judge` for what is ignored."""
    out = [outcome_of(image, least_score, wanted or WantedBodies()) for image in images]
    rows = [(len(one.found) + len(one.missed), len(one.found) + len(one.false), len(one.found), one.overlap) for one in out]
    return BoxCounts(*np.array(rows, dtype=np.float64).reshape(-1, 4).T)


@dataclass(frozen=True, eq=False)
class Outcome:
    """The matching of the boxes and bodies of an image at a threshold of the score.

    found (p,): rows of boxes on bodies. missed (m,): rows of bodies without a box. false (f,): rows of boxes on no body.
    overlap: sum of the IoU of the pairs.
    """

    found: Ints
    missed: Ints
    false: Ints
    overlap: float


def outcome_of(image: ImageBoxes, least_score: float, wanted: WantedBodies) -> Outcome:
    """The outcome of an image, as count_boxes counts it."""
    chosen, counted = np.flatnonzero(image.score >= least_score), np.flatnonzero(wanted.of(image))
    others = np.setdiff1d(np.arange(len(image.truth)), counted)
    found = image.found[chosen]
    iou = box_overlaps(found, image.truth, image.period)
    mine, body = best_pairs(iou[:, counted], IOU)
    left = np.setdiff1d(np.arange(len(found)), mine)
    ignored, _ = best_pairs(iou[np.ix_(left, others)], IOU)
    left = np.delete(left, ignored)
    wrong = left[image.judged[chosen[left]] & wanted.of_this_height(found[left])]
    return Outcome(chosen[mine], np.delete(counted, body), chosen[wrong], float(iou[:, counted][mine, body].sum()))


def best_moda(images: Sequence[ImageBoxes], wanted: WantedBodies | None = None) -> tuple[float, float]:
    """The highest MODA over TRIED quantiles of the scores as thresholds, and its threshold: for uncalibrated scores. NaN without boxes."""
    scores = np.concatenate([np.zeros(0), *(image.score for image in images)])
    if not len(scores):
        return float("nan"), float("nan")
    tried = np.unique(np.quantile(scores, np.linspace(0, 1, TRIED), method="nearest"))
    found = [count_boxes(images, float(least), wanted).moda() for least in tried]
    best = int(np.argmax(np.nan_to_num(found, nan=-np.inf)))
    return found[best], float(tried[best])


@dataclass(frozen=True, eq=False)
class Reliability:
    """Scores as probabilities, in BINS of the same width: boxes (bins,), mean score and share of bodies (bins,), NaN where there are no boxes."""

    boxes: Array
    score: Array
    share: Array

    @property
    def expected_error(self) -> float:
        """The expected calibration error (Guo et al. 2017, equation 3): the mean over boxes of |share of bodies − mean score| of their bin."""
        known = self.boxes > 0
        total = self.boxes.sum()
        return float((self.boxes * np.abs(self.share - self.score))[known].sum() / total) if total else float("nan")


def reliability(judged: JudgedBoxes) -> Reliability | None:
    """Reliability of the scores; None where a score is outside [0, 1]."""
    if len(judged.score) and not (judged.score.min() >= 0 and judged.score.max() <= 1):
        return None
    which = np.minimum((judged.score * BINS).astype(np.int64), BINS - 1)
    boxes = np.bincount(which, minlength=BINS).astype(np.float64)
    some = np.where(boxes > 0, boxes, np.nan)
    sums = [np.bincount(which, weights=values, minlength=BINS) for values in (judged.score, judged.hit.astype(np.float64))]
    return Reliability(boxes, sums[0] / some, sums[1] / some)


def feet_errors(images: Sequence[ImageBoxes], least_score: float, wanted: WantedBodies | None = None) -> Array:
    """Distances (k,) m on the ground from the feet of found boxes to those of their bodies, where both are known; pairs as of count_boxes."""
    wanted, out = wanted or WantedBodies(), [np.zeros(0)]
    for image in images:
        chosen, counted = np.flatnonzero(image.score >= least_score), np.flatnonzero(wanted.of(image))
        mine, body = best_pairs(box_overlaps(image.found[chosen], image.truth[counted], image.period), IOU)
        apart = np.linalg.norm(image.found_feet[chosen[mine]] - image.truth_feet[counted[body]], axis=1)
        out.append(apart[np.isfinite(apart)])
    return np.concatenate(out)
