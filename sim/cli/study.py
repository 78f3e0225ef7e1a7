"""The command `pilsim study`: repeat the studies of the paper."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from tyro.conf import Positional

from sim.cli.options import Out, unset
from tracker.options import Least


@dataclass(frozen=True)
class Study:
    """Repeat a study of the paper on synthetic people and on PETS 2009.

    fig4: K_H = 1 to 30 and i_bls^max = 500 to 2000, on PETS 2009 as it is and with
    false boxes. It writes cells.csv (a run a row), fig4.png (processing time and MOTA
    with their spread over repetitions) and fig4.txt (the table and its summary).

    graphs: a small graph for each hypothesis, or one graph of all tracks. Searches
    start from the surviving tracks, or without them. It writes runs.csv, graphs.txt
    and graphs.png (time, missing share of the optimal weight, MOTA).

    images: corner tracklets with the paper's L_c, δ_min and ω, with other values, and
    none, on rendered people and on videos of PETS 2009. It writes cells.csv,
    images.png (MOTA, IDF1, switches, time), images.txt and the recordings.

    The same command continues a study that was interrupted.

    Examples: pilsim study fig4 --out runs/fig4 --pets PETS2009/S2.L1
              pilsim study graphs --out runs/graphs --repetitions 3 --frames 60
              pilsim study images --out runs/images --repetitions 3 --pets PETS2009/S2.L1
    """

    name: Positional[Literal["fig4", "graphs", "images"]]
    """The study."""
    out: Out
    """Folder of the results."""
    pets: Annotated[Path | None, unset("DIR", "synthetic people alone")] = None
    """A PETS 2009 folder; its views 1, 5 and 7 are used (images: view 1 alone, too)."""
    repetitions: Annotated[int, Least(1)] = 20
    """Runs of each setting, each with another seed."""
    frames: Annotated[int, Least(1)] = 200
    """Frames of each run."""

    def run(self) -> None:
        from sim.studies import STUDIES
        from tracker.io.atomic import write_text
        from tracker.io.file_lock import folder_lock
        from tracker.io.progress import progress_bar

        form = STUDIES[self.name]
        # A bad folder is refused before the first run, which takes long.
        materials = form.materials(self.out, self.pets, self.frames)
        with folder_lock(self.out):
            asked, note = f"frames {self.frames}, searches as they are, {form.people} people\n", self.out / "frames.txt"
            if note.is_file() and note.read_text() != asked:
                raise ValueError(f"{self.out}: holds another study ({note.read_text().strip()} there, {asked.strip()} asked for)")
            write_text(note, asked)
            cells = form.cells(self.out, materials, self.repetitions)
            made = list(progress_bar(cells, total=form.count(materials, self.repetitions), unit="run"))
            form.draw(made, self.out / f"{self.name}.png")
            text = form.summary(made)
            print(text)
            write_text(self.out / f"{self.name}.txt", text + "\n")
