"""The command `pilsim report`: write a page about a stress test."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from sim.cli.options import unset


@dataclass(frozen=True)
class Report:
    """Make a page of a stress test: what failed first, why, and bounds.

    The page is one HTML file without scripts; it needs no network. FOLDER/report
    holds each plot as PNG and CSV. The command also works during a stress test.

    Examples: pilsim report runs/stress
              pilsim report runs/stress --out density.html
    """

    folder: Annotated[Positional[Path], arg(metavar="FOLDER")]
    """The folder with results.jsonl, as `pilsim stress` writes it."""
    out: Annotated[Path | None, unset("FILE", "FOLDER/report.html")] = None
    """The page to write."""

    def run(self) -> None:
        from sim.report.report import write_report
        from tracker.io.file_lock import folder_lock, output_file_lock

        if not self.folder.is_dir():
            raise ValueError(f"{self.folder}: no such folder")
        with folder_lock(self.folder / "report"), output_file_lock(self.out or self.folder / "report.html"):
            path = write_report(self.folder, self.out)
        print(f"{path}: the page ({path.stat().st_size / 1e6:.1f} MB); plots as PNG and CSV in {self.folder / 'report'}")
