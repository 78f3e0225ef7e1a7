"""A sequence in space and time."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional

from sim.commands.options import unset


@dataclass(frozen=True)
class View:
    """Look at a sequence in space and time with Rerun: terrain, robots with their trails and panoramas, people, tracks, covariances.

    Needs the extra `view`: pip install "pilsim[view]". True people are grey, tracks have a colour an id; ellipsoids hold two standard deviations.

    Examples: pilsim view runs/demo
              pilsim view runs/demo/sequence --track
              pilsim view runs/demo --save demo.rrd     (then: rerun demo.rrd)
    """

    folder: Positional[Path]
    """A sequence, or what `demo` left: its sequence with its tracks."""
    results: Annotated[Path | None, unset("DIR", "FOLDER/track, if there")] = None
    """What `track` left of this sequence."""
    track: bool = False
    """Track it now instead: covariances of people, which files of tracks do not hold, are then shown, too."""
    save: Annotated[Path | None, unset("FILE.rrd", "the viewer opens")] = None
    """Write a recording instead of opening the viewer."""

    def run(self) -> None:
        from sim.spectator import show

        show(self.folder, self.results, self.track, self.save)
