"""From a scenario to a sequence."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from tyro.conf import Positional, arg

from sim.commands.options import Out, numbers


@dataclass(frozen=True)
class Generate:
    """Generate a sequence: the twin of a PETS 2009 sequence, its people on their real paths before the real cameras and before rovers.

    Example: pilsim generate twin --annotations S2.L1/annotations/PETS2009-S2L1.xml --calibration calibration --views 1,5,7 --out runs/twin
    """

    preset: Positional[Literal["twin"]]
    """What kind of sequence."""
    annotations: Annotated[Path, arg(metavar="FILE")]
    """Who walked where: the CVML file of any PETS 2009 sequence, boxes in View_001."""
    calibration: Annotated[Path, arg(metavar="DIR")]
    """Folder of View_001.xml and so on (Tsai)."""
    out: Out
    """Where the sequence goes; must not be there yet."""
    views: str = "1"
    """Numbers of the PETS cameras that look on, as in 1,5,7."""
    frames: int | None = None
    """How many of the annotated frames, from the first on; all where it is not given."""
    robots: int = 2
    """Rovers with a panoramic camera each."""
    width: int = 1024
    """Of a panorama in pixels."""
    seed: int = 0
    """Of everything random."""

    def run(self) -> None:
        from functools import partial

        from tqdm import tqdm

        from sim.twin import Twin, generate, likeness

        views = tuple(numbers(self.views))
        twin = Twin(self.annotations, self.calibration, views, self.frames, self.robots, self.width, self.seed)
        generate(twin, self.out, progress=partial(tqdm, desc="frames", unit="frame"))
        print(f"{self.out}: a sequence (README.md in it); `pilsim track {self.out}` tracks it")
        if 1 in views:
            alike = sorted(likeness(twin, self.out).tolist())
            print(f"overlap of {len(alike)} annotated boxes with the twin's in View_001: median IoU {alike[len(alike) // 2]:.3f}")
