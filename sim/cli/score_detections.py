"""The command `pilsim score-detections`: score the boxes of a detector against true boxes."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from tyro.conf import arg

from sim.cli.options import json_text, unset

if TYPE_CHECKING:
    from tracker.metrics.box_detection import ImageBoxes, WantedBodies

Table = dict[str, dict[str, Any]]
HEIGHTS = (0.0, 16.0, 32.0, 64.0, 128.0, 256.0, 512.0, float("inf"))
VISIBLE = (0.0, 0.3, 0.5, 0.8, 0.95, float("inf"))


@dataclass(frozen=True)
class ScoreDetections:
    """Score the boxes of a detector: AP, MODA, MODP, feet.

    AP is average precision. Truth is a sequence of pilsim, a recording, or a MOT15
    file. The result is what `detect` writes. True boxes of PETS 2009 are those of
    View_001; other views and places have bodies of 1.75 x 0.5 m.

    Examples: pilsim detect S2.L1 --cameras 1 --frames 0:400 --out runs/boxes
              pilsim score-detections --truth S2.L1 --result runs/boxes --plot reliability.png
    """

    truth: Annotated[tuple[Path, ...], arg(metavar="SOURCE [SOURCE ...]")]
    """Sources with true people; several are scored together."""
    result: Annotated[tuple[Path, ...], arg(metavar="DIR|FILE [DIR|FILE ...]")]
    """The boxes found in each source: a folder of CAMERA.txt, or a MOT15 file of one camera."""
    cameras: Annotated[str, unset("NAME,...", "all with a result")] = ""
    """Cameras to score, as C1,C3."""
    frames: Annotated[str, unset("A:B", "those that `detect` searched")] = ""
    """Frames of the source to score, counted from 0, without B."""
    min_score: float = 0.5
    """Least score of a box for MODA, MODP, precision, recall and feet."""
    min_visible: float = 0.5
    """Bodies of which less is seen are ignored, where the visible share is known."""
    heights: Annotated[str, unset("A:B", "all")] = ""
    """Heights of bodies in px that have to be found, as 20:256; others are ignored."""
    plot: Annotated[Path | None, unset("FILE.png", "none")] = None
    """Draw the reliability of the scores, and precision over recall."""
    out: Annotated[Path | None, unset("FILE.json", "none")] = None
    """Write the scores as JSON."""
    json: bool = False
    """Print JSON alone."""

    def run(self) -> None:
        from tracker.io.atomic import write_text
        from tracker.io.file_lock import output_file_lock

        self._check()
        with ExitStack() as locks:
            for path in filter(None, (self.out, self.plot)):
                locks.enter_context(output_file_lock(path))
            images = self._images()
            scores = self._scores(images)
            if self.out is not None:
                write_text(self.out, json_text(scores, indent=1) + "\n")
            if self.plot is not None:
                from sim.visualization.detector_picture import draw_reliability
                from tracker.metrics.box_detection import judge

                draw_reliability(judge(images, self._wanted())[0], self.plot)
        print(json_text(scores, indent=1) if self.json else table(scores))

    def _check(self) -> None:
        import math

        if len(self.truth) != len(self.result) or not self.truth:
            raise ValueError(f"--truth names {len(self.truth)} and --result {len(self.result)}, needs one result for each source")
        for option, path, ending in (("--out", self.out, ".json"), ("--plot", self.plot, ".png")):
            if path is not None and path.suffix.lower() != ending:
                raise ValueError(f"{option} is {path}, needs a name that ends in {ending}")
        if not math.isfinite(self.min_score):
            raise ValueError(f"--min-score is {self.min_score}, needs a finite number")
        if not 0 <= self.min_visible <= 1:
            raise ValueError(f"--min-visible is {self.min_visible}, needs 0 to 1")
        self._wanted()

    def _wanted(self) -> WantedBodies:
        from tracker.metrics.box_detection import WantedBodies

        low, high = 0.0, float("inf")
        if self.heights:
            first, colon, last = self.heights.partition(":")
            try:
                low, high = float(first or 0), float(last or "inf")
            except ValueError:
                colon = ""
            if not colon or not 0 <= low < high:
                raise ValueError(f"--heights is {self.heights!r}, needs LOW:HIGH px as in 20:256, the lower first")
        return WantedBodies((low, high), (self.min_visible, float("inf")))

    def _images(self) -> list[ImageBoxes]:
        from tracker.datasets.source_options import SourceOptions
        from tracker.detection_scoring import images_of
        from tracker.io.progress import progress_bar

        options, out = SourceOptions.parse(cameras=self.cameras, frames=self.frames), []
        pairs = list(zip(self.truth, self.result, strict=True))
        for truth, result in progress_bar(pairs, desc="sources", unit="source", disable=self.json or len(pairs) == 1, leave=False):
            out += images_of(truth, result, options)
        return out

    def _scores(self, images: list[ImageBoxes]) -> dict[str, Any]:
        from tracker.metrics.box_detection import WantedBodies

        wanted = self._wanted()
        scores: dict[str, Any] = {"all": headline(images, wanted, self.min_score)}
        low, high = wanted.heights
        heights = {f"{a:g}-{b:g} px": WantedBodies((max(a, low), min(b, high)), wanted.visible) for a, b in pairwise(HEIGHTS) if a < high and b > low}
        scores["by_height"] = {name: part for name, one in heights.items() if (part := self._part(images, one))["bodies"]}
        if any(len(image.visible) and image.visible[0] >= 0 for image in images):
            shares = {f"{a:g}-{min(b, 1):g}": WantedBodies(wanted.heights, (a, b)) for a, b in pairwise(VISIBLE)}
            scores["by_visible_share"] = {name: part for name, one in shares.items() if (part := self._part(images, one))["bodies"]}
        for title, of in (("by_world", "world"), ("by_camera", "camera")):
            names = sorted({getattr(image, of) for image in images})
            groups = {name: [image for image in images if getattr(image, of) == name] for name in names}
            if len(names) > 1:
                scores[title] = {name: self._part(group, wanted) for name, group in groups.items()}
        return scores

    def _part(self, images: list[ImageBoxes], wanted: WantedBodies) -> dict[str, Any]:
        from tracker.metrics.box_detection import count_boxes, judge

        counts = count_boxes(images, self.min_score, wanted)
        ap = judge(images, wanted)[0].average_precision()
        numbers = {"ap50": ap, "moda": counts.moda(), "modp": counts.modp(), "precision": counts.precision, "recall": counts.recall}
        return {"images": len(images), "bodies": int(counts.bodies.sum())} | _rounded(numbers)


def headline(images: list[ImageBoxes], wanted: WantedBodies, min_score: float) -> dict[str, Any]:
    """All figures of some images; `intervals` has 95 % intervals by resampling of images. None where a figure is not defined."""
    import numpy as np

    from sim.confidence_intervals import image_interval
    from tracker.metrics.box_detection import IOUS, best_moda, count_boxes, feet_errors, judge, reliability

    levels = judge(images, wanted, IOUS)
    counts, feet, sure = count_boxes(images, min_score, wanted), feet_errors(images, min_score, wanted), reliability(levels[0])
    best, at = best_moda(images, wanted)
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
    """JSON has no NaN: what is not defined is None."""
    return {name: None if value != value else round(value, 4) for name, value in numbers.items()}


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
