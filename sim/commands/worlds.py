"""The places that there are."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from sim.commands.options import unset


@dataclass(frozen=True)
class Worlds:
    """List the worlds with their measures, draw them, or give one away for other programs.

    Examples: pilsim worlds
              pilsim worlds --preview runs/worlds --difficulty 1
              pilsim worlds quarry --seed 3 --export quarry.glb
    """

    name: Positional[Annotated[str | None, unset("[WORLD]", "all of them")]] = None
    """One world."""
    difficulty: float = 0.5
    """Of relief, steps, clutter and occlusion, from 0 (gentle) to 1 (rovers begin to fail)."""
    seed: int = 0
    """Another seed is another place of the same kind."""
    preview: Annotated[Path | None, unset("DIR", "none is drawn")] = None
    """Draw NAME.png into this folder: as a rover sees it, from above, and the plan."""
    export: Annotated[Path | None, unset("FILE", "none is written")] = None
    """Write the scene of the named world; the ending says how: .glb, .obj, .ply, .xml (MJCF and its files), .mjz (MuJoCo's archive)."""
    slip: Annotated[float, arg(metavar="SECONDS", help_behavior_hint="(default: not measured)")] = 0.0
    """Drive four rovers for so long and measure how far wheel odometry is off, a metre driven."""
    json: bool = False
    """Print JSON alone."""

    def run(self) -> None:
        from sim.gallery import Wanted, describe, survey

        rows = survey(self.name, self.difficulty, self.seed, Wanted(self.preview, self.export, self.slip))
        print(json.dumps(rows, indent=1) if self.json else describe(rows))
