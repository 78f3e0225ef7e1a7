"""A stress test as a page."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional

from sim.commands.options import unset


@dataclass(frozen=True)
class Report:
    """Turn what `stress` left in a folder into a page to read: what was tested, what broke first, why, and how far the limits are.

    One HTML file without scripts that needs no network; PNG and CSV of each plot go to FOLDER/report. May be run while a stress test goes on.

    Examples: pilsim report runs/stress
              pilsim report runs/stress --out density.html
    """

    folder: Positional[Path]
    """The folder with results.jsonl."""
    out: Annotated[Path | None, unset("FILE", "FOLDER/report.html")] = None
    """The page."""

    def run(self) -> None:
        from sim.report import write_report

        path = write_report(self.folder, self.out)
        print(f"{path}: the page ({path.stat().st_size / 1e6:.1f} MB); plots as PNG and CSV in {self.folder / 'report'}")
