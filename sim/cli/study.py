"""The command `pilsim study`: repeat the studies of the paper."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from tyro.conf import Positional

from sim.cli.options import Out, unset
from tracker.options import Least

if TYPE_CHECKING:
    from sim.studies.hypothesis_count import Material


@dataclass(frozen=True)
class Study:
    """Repeat a study of the paper on synthetic people and on PETS 2009.

    fig4: K_H = 1 to 30 and i_bls^max = 500 to 2000, on PETS 2009 as it is and with
    false boxes. It writes cells.csv (a run a row), fig4.png (processing time and MOTA
    with their spread over repetitions) and fig4.txt (the table and its summary).

    graphs: a small graph for each hypothesis beside one graph of all tracks. Searches
    start from the surviving tracks, or without them. It writes runs.csv, graphs.txt
    and graphs.png (time, weight beside the proved optimum, MOTA).

    images: tracklets of corners with the paper's L_c, δ_min and ω and with others,
    beside none, on rendered people and on videos of PETS 2009. It writes cells.csv,
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
        from sim.studies import hypothesis_count
        from tracker.io.file_lock import folder_lock

        if self.pets is not None:
            # A bad folder is refused before the first run, which takes long.
            hypothesis_count.check(self.pets, self.name == "images")
        with folder_lock(self.out):
            self._run()

    def _run(self) -> None:
        """Run the study in its folder, whose lock is held."""
        from sim.studies import hypothesis_count, image_tracklets
        from tracker.io.atomic import write_text

        people = image_tracklets.CROWD.people if self.name == "images" else hypothesis_count.PEOPLE
        asked, note = f"frames {self.frames}, searches as they are, {people} people\n", self.out / "frames.txt"
        if note.is_file() and note.read_text() != asked:
            raise ValueError(f"{self.out}: holds another study ({note.read_text().strip()} there, {asked.strip()} asked for)")
        write_text(note, asked)
        text = {"fig4": self._fig4, "graphs": self._graphs, "images": self._images}[self.name]()
        print(text)
        write_text(self.out / f"{self.name}.txt", text + "\n")

    def _materials(self, degradations: tuple[str, ...]) -> list[Material]:
        from sim.studies import hypothesis_count

        real = [] if self.pets is None else [hypothesis_count.pets(self.pets, self.frames, degradation) for degradation in degradations]
        return [hypothesis_count.synthetic(self.frames), *real]

    def _fig4(self) -> str:
        from sim.studies import hypothesis_count

        materials = self._materials(("", hypothesis_count.DEGRADATION))
        total = len(materials) * self.repetitions * len(hypothesis_count.K_H) * len(hypothesis_count.I_BLS_MAX)
        return self._finished(hypothesis_count, hypothesis_count.study(self.out, materials, self.repetitions), total)

    def _graphs(self) -> str:
        from sim.studies import clique_graphs

        materials = self._materials(("",))
        total = len(materials) * self.repetitions * len(clique_graphs.FORMS) * len(clique_graphs.STARTS)
        return self._finished(clique_graphs, clique_graphs.study(self.out, materials, self.repetitions), total)

    def _images(self) -> str:
        from sim.studies import image_tracklets

        materials = image_tracklets.materials(self.out, self.pets)
        total = image_tracklets.count_runs(materials, self.repetitions)
        return self._finished(image_tracklets, image_tracklets.study(self.out, materials, self.frames, self.repetitions), total)

    def _finished(self, study: Any, runs: Iterator[Any], total: int) -> str:
        """Run what is left of a study, and draw it; its summary. study: its module. runs: each of `total` runs."""
        from tracker.io.progress import progress_bar

        made = list(progress_bar(runs, total=total, unit="run"))
        study.FORM.draw(made, self.out / f"{self.name}.png")
        return str(study.FORM.summary(made))
