"""The command `pilsim score-detections`: score the boxes of a detector against true boxes."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tyro.conf import arg

from sim.cli.options import json_text, locked, unset
from tracker.options import Ending

if TYPE_CHECKING:
    from tracker.metrics.box_detection import ImageBoxes, WantedBodies


@dataclass(frozen=True)
class ScoreDetections:
    """Score the boxes of a detector: AP, MODA, MODP, feet.

    AP is average precision, also by the visible share of a body (0.1 to 0.3, 0.3 to
    0.6, above) where truth has it, as in sequences. Boxes of `detect --boxes visible`
    are scored against visible parts. Truth is a sequence of pilsim, a recording, or a
    MOT15 file. The result is what `detect` writes. True boxes of PETS 2009 are those
    of View_001; other views and places have bodies of 1.75 x 0.5 m.

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
    """Frames A to B − 1 of the source to score, counted from 0."""
    min_score: float = 0.5
    """Least score of a box for MODA, MODP, precision, recall and feet."""
    min_visible: float = 0.5
    """Bodies of which less is seen are ignored, where the visible share is known."""
    heights: Annotated[str, unset("A:B", "all")] = ""
    """Heights of bodies in px that have to be found, as 20:256; others are ignored."""
    plot: Annotated[Path | None, Ending(".png"), unset("FILE.png", "none")] = None
    """Draw the reliability of the scores, and precision over recall."""
    sheet: Annotated[Path | None, Ending(".png"), unset("FILE.png", "none")] = None
    """Draw found and missed people and false boxes of each world, cut out of the images."""
    out: Annotated[Path | None, Ending(".json"), unset("FILE.json", "none")] = None
    """Write the scores as JSON."""
    json: bool = False
    """Print JSON alone."""

    def run(self) -> None:
        from tracker.io.atomic import write_text
        from tracker.metrics.box_scores import box_scores, table

        self._check()
        wanted = self._wanted()
        with locked(self.out, self.plot, self.sheet):
            sources = self._images()
            images = [image for of in sources.values() for image in of]
            scores = box_scores(images, wanted, self.min_score)
            if self.out is not None:
                write_text(self.out, json_text(scores, indent=1) + "\n")
            if self.plot is not None:
                from sim.visualization.detector_picture import draw_reliability
                from tracker.metrics.box_detection import judge

                draw_reliability(judge(images, wanted)[0], self.plot)
            if self.sheet is not None:
                from sim.visualization.detection_sheet import draw_sheet

                draw_sheet(sources, wanted, self.min_score, self.sheet)
        print(json_text(scores, indent=1) if self.json else table(scores))

    def _check(self) -> None:
        import math

        if len(self.truth) != len(self.result) or not self.truth:
            raise ValueError(f"--truth names {len(self.truth)} and --result {len(self.result)}, needs one result for each source")
        if not math.isfinite(self.min_score):
            raise ValueError(f"--min-score is {self.min_score}, needs a finite number")
        if not 0 <= self.min_visible <= 1:
            raise ValueError(f"--min-visible is {self.min_visible}, needs 0 to 1")

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

    def _images(self) -> dict[Path, list[ImageBoxes]]:
        from tracker.formats.source_options import SourceOptions
        from tracker.io.progress import progress_bar
        from tracker.metrics.scored_images import images_of

        options = SourceOptions.parse(cameras=self.cameras, frames=self.frames)
        out: dict[Path, list[ImageBoxes]] = {}
        pairs = list(zip(self.truth, self.result, strict=True))
        for truth, result in progress_bar(pairs, desc="sources", unit="source", disable=self.json or len(pairs) == 1, leave=False):
            out.setdefault(truth, []).extend(images_of(truth, result, options))
        return out
