"""The command `pilsim check`: verify a dataset, or the calibration of a recording."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from tyro.conf import OmitArgPrefixes, Positional, arg

from sim.cli.options import json_text, unset
from sim.cli.track import SourceChoice
from tracker.options import Ending

SHOWN = 100
"""Largest number of faults that are printed. All faults are counted."""


@dataclass(frozen=True)
class Check:
    """Verify a dataset, or the calibration of a recording.

    A dataset or sequence of pilsim: each fault is a line, FILE: what is wrong.
    The command checks checksums and sizes, and that no frame is missing. It checks
    that every image decodes to the size of its camera, and that boxes match the
    instance masks to the pixel. It checks that key points project from the joints,
    and that values are within their bounds.

    Another source with fixed cameras is a recording of your own, WILDTRACK or
    PETS 2009, for instance. The command prints a line per camera, and what looks wrong.
    It detects wrong units (mm, cm), inverted R or t, and wrong camera axes. It detects
    boxes of other or mirrored images, swapped cameras, frames with shifted numbers or
    without boxes, and images that do not fit.

    The exit code is 0 where nothing is wrong, and 2 where an error is named. It is 1
    where the boxes do not fit the calibration and no known error explains it. Then
    `calibrate --from current` finds what has moved, and `calibrate` calibrates anew.

    Examples: pilsim check D
              pilsim check D/pilsun-00000 --json
              pilsim check MY_RECORDING --picture calibration.png
    """

    source: Annotated[Positional[Path], arg(metavar="DIR")]
    """The dataset, sequence or recording."""
    picture: Annotated[Path | None, Ending(".png"), unset("FILE.png", "none")] = None
    """Recordings: draw the plan, and the view of each camera with the ground grid."""
    choice: OmitArgPrefixes[SourceChoice] = SourceChoice()
    json: bool = False
    """Print JSON alone: {"faults": [{"file": …, "reason": …}, …], "count": …}; of
    recordings {"cameras": […], "findings": [{"kind": …, "words": …}, …]}."""

    def run(self) -> None:
        from tracker.formats.opening import is_pilsim

        # A missing folder or an unknown format is reported by the check of datasets or by the opening.
        if is_pilsim(self.source):
            self._dataset()
        else:
            self._recording()

    def _dataset(self) -> None:
        from tracker.datasets.validation import validate
        from tracker.io.progress import print_line, progress_bar
        from tracker.sequence.dataset import sequences

        if self.picture is not None or self.choice != SourceChoice():
            raise ValueError(
                f"{self.source}: is of pilsim, whose checksums are checked as a whole; --picture and the choice of data are for recordings"
            )

        def shown(items: Iterable[Any], name: str, total: int) -> Iterable[Any]:
            return progress_bar(items, desc=name, total=total, leave=False, disable=self.json)

        faults, count = [], 0
        for fault in validate(self.source, shown):
            count += 1
            if count <= SHOWN:
                faults.append({"file": str(fault.file), "reason": fault.reason})
                if not self.json:
                    print_line(str(fault))
        if self.json:
            print(json_text({"faults": faults, "count": count}, indent=1))
        if count:
            raise ValueError(f"{self.source}: {count} fault{'s' * (count > 1)}{f', the first {SHOWN} are named' * (count > SHOWN)}")
        if not self.json:
            count = len(sequences(self.source))
            print(f"{self.source}: {count} sequence{'s' * (count != 1)}, no fault")

    def _recording(self) -> None:
        from tracker.formats.opening import open_recording
        from tracker.recordings.calibration_check import LEGEND, check_calibration

        recording = open_recording(self.source, self.choice.options(images=self.picture is not None), strict=False)
        report = check_calibration(recording)
        if self.json:
            print(json_text(report.to_json(), indent=1))
        else:
            print("\n".join(report.lines()))
            print(LEGEND)
        if self.picture is not None:
            from sim.visualization.calibration_picture import draw_calibration

            draw_calibration(recording, report, self.picture)
            if not self.json:
                print(f"wrote {self.picture}")
        if report.unexplained:
            hint = f"`pilsim calibrate {self.source} --from current --out DIR` tells what has moved"
            print(f"{self.source}: something is wrong, and no known error explains it; {hint}", file=sys.stderr)
            sys.exit(1)
        if count := len(report.findings):
            raise ValueError(f"{self.source}: {count} thing{'s' * (count > 1)} look{'s' * (count == 1)} wrong")
        if not self.json:
            tested = any(one.boxes for one in report.cameras)
            print(f"{self.source}: {'nothing looks wrong' if tested else 'no boxes, so the calibration cannot be tested'}")
