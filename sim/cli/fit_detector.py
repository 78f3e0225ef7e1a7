"""The command `pilsim fit-detector`: fit the error model of a detector to truth and detections."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tyro.conf import OmitArgPrefixes, Positional, arg

from sim.cli.options import json_text, locked, unset
from sim.cli.track import SourceChoice
from tracker.options import Ending

if TYPE_CHECKING:
    from tracker.detector_models.fitting import Fit, Source


@dataclass(frozen=True)
class FitDetector:
    """Fit the errors of a detector to truth and detections.

    The model has rates and durations of misses, errors of edges, confidences, merged
    boxes, second boxes of a person, and new and lasting false boxes.
    Every figure has a 95 % interval. `generate`, `stress`, `demo` and `place`
    simulate the model: --detector-model FILE.

    Examples: pilsim fit-detector MY_RECORDING --out detector.json --picture detector.png
              pilsim fit-detector S2.L1 --cameras 1 --frames 0:400 --out detector.json
              pilsim fit-detector CMC1 CMC2 --detections detections-faster-rcnn --out detector.json
    """

    source: Annotated[Positional[tuple[Path, ...]], arg(metavar="DIR [DIR ...]", help_behavior_hint="(at least one)")]
    """Recordings with truth, PETS 2009 or WILDTRACK; several are fitted together."""
    out: Annotated[Path, Ending(".json"), arg(metavar="FILE.json")]
    """The model."""
    picture: Annotated[Path | None, Ending(".png"), unset("FILE.png", "none")] = None
    """Draw all figures on one page."""
    name: Annotated[str, unset("NAME", "the name of the file")] = ""
    """Name of the model."""
    choice: OmitArgPrefixes[SourceChoice] = SourceChoice()
    json: bool = False
    """Print JSON alone: the figures, and the distances of simulated boxes from real ones."""

    def run(self) -> None:
        from tracker.detector_models.fitting import fit_sources
        from tracker.detector_models.model import model_text
        from tracker.io.atomic import write_text

        if not self.source:
            raise ValueError("a folder is missing, needs one recording or more")
        sources = self._sources()
        with locked(self.out, self.picture):
            try:
                found = fit_sources(sources, self.name or self.out.stem)
            except ValueError as error:
                raise ValueError(f"{', '.join(map(str, self.source))}: {error}") from None
            write_text(self.out, model_text(found.model))
            if self.picture is not None:
                from sim.visualization.detector_picture import draw_detector

                draw_detector(found, self.picture)
        self._print(found)

    def _sources(self) -> list[Source]:
        from tracker.detector_models.fitting import open_source
        from tracker.io.progress import progress_bar

        opened = []
        for path in progress_bar(self.source, desc="sources", unit="source", disable=self.json or len(self.source) == 1, leave=False):
            # A folder of detections may be named relative to each source.
            given = tuple(str(path / text) if "=" not in text and (path / text).is_dir() else text for text in self.choice.detections)
            opened.append(open_source(path, replace(self.choice, detections=given).options(images=False)))
        return opened

    def _print(self, found: Fit) -> None:
        from tracker.detector_models.comparison import table
        from tracker.detector_models.fitting import places_note

        model = found.model
        if self.json:
            content = {"name": model.name, "figures": model.figures, "counts": model.counts, "distances": found.distances}
            print(json_text(content, indent=1))
            return
        for name, (value, low, high) in model.figures.items():
            print(f"{name:34} {value:9.4f}  [{low:.4f}, {high:.4f}]")
        print("\n".join(table(found.distances)))
        if model.bodies == "places":
            print(places_note(model))
        if model.counts["unjudged"]:
            print(f"{model.counts['unjudged']} boxes beyond the area, where truth may end, are not judged.")
        print(f"{self.out}: the model of {model.counts['found']} boxes of {model.counts['people']} people; --detector-model {self.out} simulates it")
