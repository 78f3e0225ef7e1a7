"""All scores of a detector's boxes: figures with their intervals, and parts by height, visible share, world and camera."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from tracker.geometry import Array
from tracker.metrics.box_detection import IOUS, ImageBoxes, WantedBodies, best_moda, count_boxes, feet_errors, judge, reliability

HEIGHTS = (0.0, 16.0, 32.0, 64.0, 128.0, 256.0, 512.0, float("inf"))
"""px: bounds of the heights by which bodies are scored."""
VISIBLE = (0.1, 0.3, 0.6, float("inf"))
"""Bounds of the visible shares by which bodies are scored: a part of a body, about half, and most of it. Bodies with less are left out."""
BLOCK, FEWEST_BLOCKS, RESAMPLES = 20, 6, 500
"""Most images of a block that is drawn whole, fewest blocks of an interval, and resamples."""
SEED = 20090
"""Each interval uses a generator of its own with this seed, so the same images always give the same interval."""


def box_scores(images: Sequence[ImageBoxes], wanted: WantedBodies, min_score: float) -> dict[str, Any]:
    """Scores as JSON values: `all` (headline), `by_height`, `by_visible_share` if known, and for several worlds or cameras `by_world`, `by_camera`.

    min_score: least score of a box for MODA, MODP, precision, recall and feet.
    """
    scores: dict[str, Any] = {"all": headline(images, wanted, min_score)}
    low, high = wanted.heights
    heights = {f"{a:g}-{b:g} px": WantedBodies((max(a, low), min(b, high)), wanted.visible) for a, b in pairwise(HEIGHTS) if a < high and b > low}
    parts = {"by_height": heights}
    if any(len(image.visible) and image.visible[0] >= 0 for image in images):
        parts["by_visible_share"] = {f"{a:g}-{min(b, 1):g}": WantedBodies(wanted.heights, (a, b)) for a, b in pairwise(VISIBLE)}
    for title, bodies in parts.items():
        scores[title] = {name: part for name, one in bodies.items() if (part := _part(images, one, min_score))["bodies"]}
    for title, of in (("by_world", "world"), ("by_camera", "camera")):
        names = sorted({getattr(image, of) for image in images})
        if len(names) > 1:
            scores[title] = {name: _part([one for one in images if getattr(one, of) == name], wanted, min_score) for name in names}
    return scores


def _part(images: Sequence[ImageBoxes], wanted: WantedBodies, min_score: float) -> dict[str, Any]:
    counts = count_boxes(images, min_score, wanted)
    ap = judge(images, wanted)[0].average_precision()
    numbers = {"ap50": ap, "moda": counts.moda(), "modp": counts.modp(), "precision": counts.precision, "recall": counts.recall}
    return {"images": len(images), "bodies": int(counts.bodies.sum())} | _rounded(numbers)


def headline(images: Sequence[ImageBoxes], wanted: WantedBodies, min_score: float) -> dict[str, Any]:
    """All figures of some images; `intervals` has 95 % intervals by resampling of images. None where a figure is not defined."""
    levels = judge(images, wanted, IOUS)
    counts, feet, sure = count_boxes(images, min_score, wanted), feet_errors(images, min_score, wanted), reliability(levels[0])
    best, at = max(best_moda(images, wanted), (counts.moda(), min_score), key=lambda one: one[0])
    numbers = {
        "ap50": levels[0].average_precision(),
        "ap50_95": float(np.mean([level.average_precision() for level in levels])),
        "moda": counts.moda(),
        "modp": counts.modp(),
        "modp_by_image": counts.modp_by_image,
        "precision": counts.precision,
        "recall": counts.recall,
        "best_moda": best,
        "best_moda_score": at,
        "calibration_error": float("nan") if sure is None else sure.expected_error,
        "feet_median_m": float(np.median(feet)) if len(feet) else float("nan"),
        "feet_90_m": float(np.quantile(feet, 0.9)) if len(feet) else float("nan"),
    }
    figures = {"ap50": levels[0].average_precision, "moda": counts.moda, "modp": counts.modp}
    intervals = {name: image_interval(of, len(images)) for name, of in figures.items()}
    bins = {} if sure is None else {"boxes": sure.boxes, "score": sure.score, "share": sure.share}
    return {
        "images": len(images),
        "bodies": int(counts.bodies.sum()),
        "boxes": int(counts.boxes.sum()),
        "feet": len(feet),
        **_rounded(numbers),
        "intervals": {name: None if one is None else [round(value, 4) for value in one] for name, one in intervals.items()},
        "reliability": {name: [None if np.isnan(v) else round(float(v), 4) for v in values] for name, values in bins.items()},
    }


def _rounded(numbers: dict[str, float]) -> dict[str, float | None]:
    """Rounded values; None in place of NaN, which JSON lacks."""
    return {name: None if value != value else round(value, 4) for name, value in numbers.items()}


def image_interval(statistic: Callable[[Array], float], count: int) -> tuple[float, float] | None:
    """The 95 % percentile bootstrap interval (Efron 1979) of a figure of `count` images in the order of their recording.

    statistic: weights (count,), which are how often each image is drawn, → the figure. Images are drawn in blocks of up to BLOCK neighbours,
    since neighbours are alike (Künsch 1989). None with fewer than FEWEST_BLOCKS blocks, and where the figure is not defined.
    """
    length = max(1, min(BLOCK, count // FEWEST_BLOCKS))
    block = np.arange(count) // length
    blocks = int(block[-1]) + 1 if count else 0
    if blocks < FEWEST_BLOCKS:
        return None
    rng = np.random.default_rng(SEED)
    drawn = [np.bincount(rng.integers(0, blocks, blocks), minlength=blocks).astype(np.float64)[block] for _ in range(RESAMPLES)]
    values = np.array([statistic(weight) for weight in drawn])
    if not np.isfinite(values).all():
        return None
    low, high = np.quantile(values, [0.025, 0.975])
    return float(low), float(high)


def table(scores: dict[str, Any]) -> str:
    """The scores as text."""
    first = scores["all"]
    lines = [f"{first['images']} images, {first['bodies']} bodies that count, {first['boxes']} boxes with the least score or more"]
    names = {
        "ap50": "AP at IoU 0.5", "ap50_95": "AP at IoU 0.5:0.95", "moda": "MODA", "modp": "MODP", "modp_by_image": "MODP, mean of images",
        "precision": "precision", "recall": "recall", "best_moda": "best MODA of all least scores", "best_moda_score": "its least score",
        "calibration_error": "expected calibration error", "feet_median_m": "feet's error, median, m", "feet_90_m": "feet's error, 90 % below, m",
    }  # fmt: skip
    for key, name in names.items():
        if first[key] is not None:
            interval = first["intervals"].get(key)
            lines.append(f"{name:30} {first[key]:8.3f}" + (f"  [{interval[0]:.3f}, {interval[1]:.3f}]" if interval else ""))
    for title in ("by_height", "by_visible_share", "by_world", "by_camera"):
        if scores.get(title):
            lines.append(f"\n{title.replace('_', ' '):24} {'bodies':>8} {'AP 0.5':>8} {'MODA':>8} {'MODP':>8} {'recall':>8}")
            for name, part in scores[title].items():
                cells = ("-" if part[key] is None else f"{part[key]:.3f}" for key in ("ap50", "moda", "modp", "recall"))
                lines.append(f"{name:24} {part['bodies']:8} " + " ".join(f"{cell:>8}" for cell in cells))
    return "\n".join(lines)
