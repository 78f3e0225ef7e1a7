"""The command `pilsim predict`: predict the scores of a tracker on given cameras, and compare them with those on the real boxes."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tyro.conf import OmitArgPrefixes, Positional, arg

from sim.cli.options import SceneOptions, Whole, command_line, given, json_text, locked, unset
from sim.cli.stress import TrackerOptions
from sim.cli.track import SourceChoice
from tracker.options import Ending, Least

if TYPE_CHECKING:
    from sim.datasets.presets import Preset
    from sim.prediction import Cells, PredictionPlan


@dataclass(frozen=True)
class Predict:
    """Predict the scores of a tracker on your cameras.

    The first half of a recording with truth gives a model of the detector's errors
    in each view. In the second half, that model simulates the boxes of the true
    people, with several seeds. A tracker runs on these twins and on the real boxes.
    The output compares scores and errors by cause. Nothing is rendered.

    For a place without a recording, --world simulates people in view of fixed cameras
    and robots. Each seed has other paths. Each seed of a world of pilsim also has
    another place of that kind.

    Examples: pilsim predict MY_RECORDING --delay 5
              pilsim predict CMC1 --detections CMC1/detections-faster-rcnn --beside independent
              pilsim predict PETS2009/S2.L1 --cameras 1,5,7 --fit 0:400 --seeds 10 --out prediction.json
              pilsim predict WILDTRACK --cameras 1,2,3 --detector-model fairmot
              pilsim predict --world house.glb --fixed-cameras 3 --people 12 --detector-model fairmot
    """

    source: Positional[Annotated[Path | None, unset("[SOURCE]", "--world")]] = None
    """A recording with truth, PETS 2009 or WILDTRACK."""
    fit: Annotated[str, unset("A:B", "the first half")] = ""
    """Frames of the fit. The frames after them are predicted, or those before where none follow."""
    detector_model: Annotated[str, unset("FILE|NAME", "fitted to the source")] = ""
    """Predict with this detector in place of the fitted one; all frames are used. A source without detections needs it; with --world: independent."""
    beside: Annotated[tuple[str, ...], arg(metavar="NAME", help_behavior_hint="(default: none)")] = ()
    """Other detectors to compare with, as independent or fairmot."""
    seeds: Annotated[int, Least(1)] = 5
    """Number of twins."""
    first_seed: Annotated[int, Least(0)] = 0
    """The first seed."""
    out: Annotated[Path | None, Ending(".json"), unset("FILE.json", "none")] = None
    """File of the result, of which `pilsim report` makes a page."""
    json: bool = False
    """Print JSON alone."""
    workers: int = 1
    """Number of processes; results do not depend on it."""
    part: Annotated[OmitArgPrefixes[SourceChoice], arg(name="source")] = SourceChoice()
    """These options choose what of a source is read, and replace or degrade its detections."""
    subject: Annotated[OmitArgPrefixes[TrackerOptions], arg(name="tracker")] = TrackerOptions()
    """These options choose the tracker."""
    scene: Annotated[OmitArgPrefixes[SceneOptions], arg(name="place")] = SceneOptions()
    """A simulated place in place of SOURCE; by default 10 people and no robots, for 60 frames (or --frames 0:END) at 6 frames a second."""
    fixed_cameras: Whole = None
    """Number of fixed cameras in the place; by default 4 without robots, 0 with robots. An MJCF file has its own."""

    def run(self) -> None:
        from sim.parallel.pool import Pool
        from sim.prediction import PredictionRecord, predict
        from sim.recording.record import versions
        from tracker.io.atomic import write_text
        from tracker.io.progress import progress_bar

        plan, pool = self._plan(), Pool(self.workers)
        with locked(self.out):
            bar = partial(progress_bar, desc="runs", unit="run", leave=False, disable=self.json)
            found = predict(plan, pool if self.workers > 1 else None, bar)
            by = plan.tracker
            subject = str(self.source or self.scene.world)
            record = PredictionRecord(subject, by.name, by.options, plan.seeds, self._command(), versions(), found)
            text = json_text(record.to_dict(), indent=1)
            if self.out is not None:
                write_text(self.out, text + "\n")
        if self.json:
            print(text)
            return
        first, end = found.frames
        fitted = "" if found.fit_frames is None else f"; models of {found.fit_frames[0]}:{found.fit_frames[1]}"
        cameras, runs = ", ".join(found.cameras), ("run" if self.source is None else "twin") + "s" * (self.seeds > 1)
        print(f"{subject}: {found.people} people in frames {first}:{end} of {cameras}{fitted}; {self.seeds} {runs}, intervals of one run, 95 %")
        if (errors := found.truth_errors) is not None:
            off = f"{errors['by_place']:.2f} m by place and {errors['deviation']:.2f} m by person"
            print(f"All views agree that the truth is off by {off}, and that statures differ by {100 * errors['stature']:.0f} %; twins do, too.")
        print("\n".join(_aligned(found.head("figure"), *found.score_lines(), *found.cause_lines())))
        if self.out is not None:
            print(f"{self.out}: written; `pilsim report {self.out}` makes a page of it")

    def _command(self) -> str:
        """The command line of this prediction, without options that do not affect its result."""
        return command_line(self, ("out", "json", "workers"), repeated=("detections",))

    def _plan(self) -> PredictionPlan:
        from sim.prediction import FITTED, PredictionPlan
        from tracker.detector_models.model import INDEPENDENT, chosen_model
        from tracker.formats.source_options import parse_frames

        if self.fit and self.detector_model:
            raise ValueError("--fit and --detector-model exclude each other: the detector is fitted, or named")
        place = self._place()
        if place is not None:
            chosen = self.detector_model or INDEPENDENT
            detectors = {chosen: chosen_model(chosen)}
        else:
            detectors = {self.detector_model or FITTED: chosen_model(self.detector_model) if self.detector_model else FITTED}
        detectors |= {name: chosen_model(name) for name in self.beside}
        if self.subject.results is not None:
            raise ValueError("--results holds tracks made elsewhere, and a prediction tracks its twins; --tracker takes a function")
        fit = parse_frames(self.fit, "--fit") if self.fit else None
        seeds = tuple(range(self.first_seed, self.first_seed + self.seeds))
        source = self.part.options(images=False)
        return PredictionPlan(self.source or Path(), source, self.subject.chosen(), detectors, fit, seeds, place)

    def _place(self) -> Preset | None:
        """The place, its people, cameras and robots; None for a recording. Raises ValueError unless exactly one of both is given."""
        from sim.datasets.presets import preset_of

        changes = given(self.scene) | ({} if self.fixed_cameras is None else {"views": self.fixed_cameras})
        if (self.source is None) == (self.scene.world is None) or (self.source is not None and changes):
            raise ValueError("needs either SOURCE, a recording, or --world and its people, robots and cameras")
        if self.source is not None:
            return None
        if self.fit or replace(self.part, frames="") != SourceChoice():
            raise ValueError(f"{self.scene.world}: --fit and the choice of data are for recordings; a place takes --frames 0:END")
        first, end = self.part.options(images=False).frames or (0, 60)
        if first or end is None:
            raise ValueError(f"--frames is {self.part.frames}, needs 0:END of a place")
        robots = self.scene.robots or 0
        return preset_of("pilsun", {"robots": robots, "views": 0 if robots else 4} | changes | {"frames": end, "width": 512})


def _aligned(head: Cells, *lines: Cells) -> list[str]:
    """The rows of a table with columns of equal width."""
    wide = [max(map(len, column)) for column in zip(head, *lines, strict=True)]
    return [f"{row[0]:{wide[0]}}" + "".join(f"  {cell:>{n}}" for cell, n in zip(row[1:], wide[1:], strict=True)) for row in (head, *lines)]
