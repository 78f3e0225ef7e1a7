"""The command `pilsim worlds`: list, draw or export worlds."""

from __future__ import annotations

from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from sim.cli.options import json_text, locked, unset


@dataclass(frozen=True)
class Worlds:
    """List the worlds with their measures, draw them, or export one.

    Examples: pilsim worlds
              pilsim worlds --preview runs/worlds --difficulty 1
              pilsim worlds quarry --seed 3 --export quarry.glb
              pilsim worlds campus --distractors 40 --preview runs/worlds
              pilsim worlds dem.png:size=60,low=0,high=6 --preview runs/worlds
    """

    name: Positional[Annotated[str | None, unset("[WORLD]", "all of them")]] = None
    """Name of one world, or a file: a height map, a mesh or MJCF (worlds/README.md)."""
    difficulty: float = 0.5
    """Difficulty of relief, steps, clutter and occlusion, from 0 (gentle) to 1 (some rovers fail)."""
    seed: int = 0
    """Seed of the world; another seed gives another place of the same kind."""
    distractors: int = 0
    """Number of things in it that detectors take for people, as `pilsim generate --distractors`."""
    preview: Annotated[Path | None, unset("DIR", "none is drawn")] = None
    """Draw NAME.png into this folder: a rover's view, a view from above, and the plan."""
    export: Annotated[Path | None, unset("FILE", "none is written")] = None
    """Write the scene of the named world as .glb, .obj, .ply, .xml (MJCF and its files) or .mjz (MuJoCo's archive)."""
    slip: Annotated[float, arg(metavar="SECONDS", help_behavior_hint="(default: not measured)")] = 0.0
    """Drive four rovers for this time, s, and measure the error of wheel odometry per meter."""
    json: bool = False
    """Print JSON alone."""

    def run(self) -> None:
        from sim.visualization.world_survey import describe, survey
        from tracker.io.file_lock import folder_lock

        with nullcontext() if self.preview is None else folder_lock(self.preview), locked(self.export):
            rows = survey(
                self.name, self.difficulty, self.seed, distractors=self.distractors, seconds=self.slip, pictures=self.preview, file=self.export
            )
        print(json_text(rows, indent=1) if self.json else describe(rows))
        if not self.json:
            for note in rows[0].get("notes", []):
                print(note)
            pictures = [] if self.preview is None else [self.preview / f"{row['world']}.png" for row in rows]
            for path in [*pictures, *([] if self.export is None else [self.export])]:
                print(f"wrote {path}")
