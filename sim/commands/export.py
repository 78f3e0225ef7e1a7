"""Sequences for other people's tools."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from tyro.conf import Positional, arg

from sim.commands.options import Out

Format = Literal["pets", "mot15", "mot17", "wildtrack", "coco", "jrdb", "tum"]


@dataclass(frozen=True)
class Export:
    """Write a sequence, or all of a dataset, in a format that other tools read. The README.md in it explains every column.

    pets: PETS 2009 (CVML truth, Tsai cameras); mot15, mot17: MOTChallenge, one sequence a view; wildtrack: Wildtrack and MultiviewX; coco:
    COCO with masks, key points and tracks; jrdb: JRDB, panoramas; tum: trajectories of robots. pets and wildtrack know only fixed pinhole cameras.

    Examples: pilsim export runs/pilsun --format mot17 --out runs/mot17
              pilsim export runs/pilsun/pilsun-00000 --format coco --out runs/coco
    """

    source: Annotated[Positional[Path], arg(metavar="DIR")]
    """A sequence, or a folder of sequences."""
    format: Format
    """What is written."""
    out: Out
    """Where it goes; must not be there yet."""
    rectangles: bool = False
    """wildtrack: write rectangles.pom, too, a line for every camera and cell: millions."""
    json: bool = False
    """Print JSON alone."""

    def run(self) -> None:
        from tqdm import tqdm

        from tracker.exporting import export

        def progress(frames: Iterable[int], name: str) -> Iterable[int]:
            return tqdm(frames, desc=name, unit="frame", disable=self.json or None)

        found = export(self.source, self.format, self.out, progress, self.rectangles)
        if self.json:
            print(json.dumps({"out": str(self.out), "format": self.format, "sequences": [str(path) for path in found]}))
        else:
            print(f"{self.out}: {len(found)} sequence{'s' * (len(found) != 1)} as {self.format}; README.md in it explains every column")
