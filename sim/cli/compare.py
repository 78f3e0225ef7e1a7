"""The command `pilsim compare`: paired differences between trackers on the same runs."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from sim.cli.options import json_text, locked, unset
from tracker.options import Ending


@dataclass(frozen=True)
class Compare:
    """Compare trackers on the same runs by differences with intervals.

    Each DIR is a folder that `stress` wrote; the first is the reference. One folder
    in which several trackers ran is enough. The table gives the differences of MOTA,
    IDF1 and ATE with 95 % intervals, for all runs and for each setting. It says
    better or worse only where the interval excludes 0.

    Example of three filters on the same 20 runs:
      pilsim stress --sweep robots/2 --seeds 20 --no-render --workers 2 --slam ekf --correction off --out runs/ekf
      pilsim stress --sweep robots/2 --seeds 20 --no-render --workers 2 --slam iekf --iterations 2 --correction on --out runs/iekf
      pilsim stress --sweep robots/2 --seeds 20 --no-render --workers 2 --out runs/default
      pilsim compare runs/ekf runs/iekf runs/default

    Examples: pilsim compare runs/before runs/after
              pilsim compare runs/both --json
              pilsim compare runs/default runs/ekf runs/mine --out differences.png
    """

    folders: Annotated[Positional[tuple[Path, ...]], arg(metavar="DIR [DIR ...]", help_behavior_hint="(at least one)")]
    """Folders of results; the first is the reference."""
    out: Annotated[Path | None, Ending(".png"), unset("FILE.png", "none is drawn")] = None
    """A picture of the differences with their intervals."""
    json: bool = False
    """Print JSON alone."""

    def run(self) -> None:
        from sim.report.comparison import compare_paired, comparison_text, draw_comparison, to_json

        if not self.folders:
            raise ValueError("compare needs folders of results, the first as the reference")
        with locked(self.out):
            found = compare_paired(self.folders)
            print(json_text(to_json(found), indent=1) if self.json else comparison_text(found))
            if self.out is not None:
                draw_comparison(found, self.out)
