"""The command `pilsim info`: summarize a dataset."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from sim.cli.options import json_text


@dataclass(frozen=True)
class Info:
    """Summarize a dataset: frames, cameras, people, boxes, density, sizes.

    DIR is a dataset, one sequence, or any source of `pilsim track`. `pilsim check`
    verifies it.

    Examples: pilsim info D
              pilsim info D/pilsun-00000 --json
              pilsim info my-cameras
    """

    source: Annotated[Positional[Path], arg(metavar="DIR")]
    """The dataset, the sequence or the source."""
    json: bool = False
    """Print JSON alone; sizes are in MB."""

    def run(self) -> None:
        from tracker.formats.summary import summarize, summary_text

        found = summarize(self.source)
        print(json_text(found, indent=1) if self.json else summary_text(found))
