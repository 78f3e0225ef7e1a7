"""The command `pilsim report`: write a page about a stress test or a prediction."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from sim.cli.options import unset
from tracker.options import Ending


@dataclass(frozen=True)
class Report:
    """Make a page of a stress test or of a prediction.

    For a stress test: what failed first, why, and bounds. For a prediction: scores
    and errors by cause, predicted and real. The page is one HTML file without
    scripts; it needs no network. FOLDER/report, or NAME-report beside NAME.json,
    holds each plot as PNG and CSV. The command also works during a stress test.

    Examples: pilsim report runs/stress
              pilsim report runs/stress --out density.html
              pilsim report runs/independent --beside runs/fairmot
              pilsim report prediction.json
    """

    folder: Annotated[Positional[Path], arg(metavar="FOLDER|FILE.json")]
    """The folder with results.jsonl, as `pilsim stress` writes it, or the file of `pilsim predict --out`."""
    out: Annotated[Path | None, Ending(".html"), unset("FILE.html", "FOLDER/report.html or FILE.html")] = None
    """The page to write."""
    beside: Annotated[tuple[Path, ...], arg(metavar="DIR [DIR ...]", help_behavior_hint="(default: none)")] = ()
    """Other folders of `pilsim stress`, shown on the same page under their names: other trackers or other detectors."""

    def run(self) -> None:
        from sim.report.page import write_report
        from sim.report.prediction_page import plots_folder, write_prediction_page
        from tracker.io.file_lock import folder_lock, output_file_lock

        prediction = self.folder.suffix.lower() == ".json" and not self.folder.is_dir()
        if not self.folder.is_dir() and not (prediction and self.folder.is_file()):
            raise ValueError(f"{self.folder}: no such {'file' if prediction else 'folder'}")
        if prediction and self.beside:
            raise ValueError("--beside is for folders of `pilsim stress`")
        beside = plots_folder(self.folder) if prediction else self.folder / "report"
        target = self.out or (self.folder.with_suffix(".html") if prediction else self.folder / "report.html")
        with folder_lock(beside), output_file_lock(target):
            path = write_prediction_page(self.folder, self.out) if prediction else write_report(self.folder, self.out, self.beside)
        print(f"{path}: the page ({path.stat().st_size / 1e6:.1f} MB); plots as PNG and CSV in {beside}")
