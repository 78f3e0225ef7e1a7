"""The command `pilsim view`: show a sequence in 3-D."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from sim.cli.options import unset


@dataclass(frozen=True)
class View:
    """Show a sequence in 3-D with Rerun: terrain, robots, people, tracks.

    The command needs the extra `view`: pip install "pilsim[view]". True people are
    grey; tracks have a color an id. Ellipsoids show two standard deviations.
    Lines from a camera show what it sees; images are shown where there are some.

    Examples: pilsim view runs/demo
              pilsim view runs/demo/sequence --track
              pilsim view my-cameras --results runs/mine --save mine.rrd
              pilsim view runs/demo --save demo.rrd     (then: rerun demo.rrd)
    """

    folder: Annotated[Positional[Path], arg(metavar="FOLDER")]
    """A sequence, a folder that `demo` wrote, or any source of `pilsim track` with cameras."""
    results: Annotated[Path | None, unset("DIR", "FOLDER/track, if there")] = None
    """The tracks that `track` wrote for this sequence."""
    track: bool = False
    """Track the sequence now. This also shows covariances of people, which files of tracks lack."""
    save: Annotated[Path | None, unset("FILE.rrd", "the viewer opens")] = None
    """Write a recording in place of opening the viewer."""

    def run(self) -> None:
        from sim.visualization.rerun_viewer import show

        show(self.folder, self.results, self.track, self.save)
