"""The command `pilsim score`: score tracks against the truth."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from tyro.conf import OmitArgPrefixes, Positional, arg

from sim.cli.options import ground_area, json_text, unset


@dataclass(frozen=True)
class Files:
    """Two files to score against each other."""

    truth: Annotated[Path | None, unset("FILE", "two folders")] = None
    """A MOT15 file with the truth, or one of MOT16 to MOT20 with nine columns."""
    result: Annotated[Path | None, unset("FILE", "two folders")] = None
    """A MOT15 file with a tracker's output."""
    iou: Annotated[float | None, unset("FLOAT", "positions on the ground within 1 m")] = None
    """Match boxes by at least this intersection over union, from 0 to 1."""
    flagged: Annotated[Literal["removed", "ignored", "counted"] | None, unset("removed|ignored|counted", "removed for boxes, else ignored")] = None
    """Truth rows with flag 0 (column 7) are removed, so that estimates on them are false
    (as in TrackEval), ignored with their estimates, or counted like all others."""


@dataclass(frozen=True)
class Score:
    """Score tracks against the truth: MOTA, IDF1, HOTA, ATE and others.

    The command scores the results of `track` against their sequence. It also scores
    any MOT15 file against another.

    Examples: pilsim score PETS2009/S2.L1 runs/pets --json
              pilsim score --truth gt.txt --result mine.txt --iou 0.5
              pilsim score $CMC/CMC1 runs/cmc1 --area 1.8,0,7.7,3.4
    """

    source: Positional[Annotated[Path | None, unset("[SOURCE]", "two files")]] = None
    """The folder that `track` read."""
    results: Positional[Annotated[Path | None, unset("[RESULTS]", "two files")]] = None
    """The folder that `track` wrote."""
    json: bool = False
    """Print JSON alone."""
    area: Annotated[str | None, unset("X0,Y0,X1,Y1", "everywhere")] = None
    """Score people on this part of the ground, in m. What is
    outside is ignored. Use it where cameras see people
    beyond the border of the truth."""
    files: Annotated[OmitArgPrefixes[Files], arg(name="two-file")] = Files()
    """These options score one MOT15 file against another, in place of two folders."""

    def run(self) -> None:
        from tracker.formats.opening import format_of, open_sequence
        from tracker.formats.registry import UTIAS
        from tracker.formats.source_options import SourceOptions
        from tracker.metrics.evaluation import efficiency, evaluate, evaluate_files, table
        from tracker.planar_slam import trajectories, utias_run
        from tracker.sequence.results import read_results

        area = ground_area(self.area) if self.area is not None else None
        if self.source and self.results and self.files == Files() and format_of(self.source).name == UTIAS:
            if area is not None:
                raise ValueError("--area is for the truth of people, and UTIAS has robots alone")
            scores = utias_run.evaluate_trajectories(self.source, self.results)
            print(json_text(scores, indent=1) if self.json else trajectories.table(scores))
            return
        if self.source and self.results and not (self.files.truth or self.files.result) and self.files.iou is None and self.files.flagged is None:
            results = read_results(self.results)
            options = SourceOptions.of_run(results.run)
            try:
                sequence = open_sequence(self.source, options)
            except ValueError as error:
                raise ValueError(f"{error} (opened as {self.results}/run.json says)" if options != SourceOptions() else str(error)) from None
            try:
                scores = evaluate(sequence, results, area)
            except ValueError as error:
                raise ValueError(f"{self.results}, scored against {self.source}: {error}") from None
            if scores["robots"]:
                scores["robots"] |= efficiency(sequence, results)
        elif self.files.truth and self.files.result and not (self.source or self.results):
            scores = evaluate_files(self.files.truth, self.files.result, self.files.iou, area, self.files.flagged)
        else:
            raise ValueError("score takes either SOURCE and RESULTS, or --truth and --result with or without --iou")
        if area is not None:
            scores["area"] = area.tolist()
        print(json_text(scores, indent=1) if self.json else table(scores))
