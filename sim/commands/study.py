"""Studies of the tracker."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from tyro.conf import Positional

from sim.commands.options import Out


@dataclass(frozen=True)
class Study:
    """Repeat a study of the paper: fig4 runs the tracker by multiple hypotheses with K_H = 1 to 30 and i_bls^max = 500 to 2000.

    On a synthetic crowd, and on PETS 2009 where a folder is named. Leaves cells.csv (one run a row), fig4.png (processing time, MOTA and its spread
    over repetitions) and fig4.txt (the same as a table, and what is seen in it). Stopped, the same command goes on from there.

    Examples: pilsim study fig4 --out runs/fig4 --pets PETS2009/S2.L1
              pilsim study fig4 --out runs/quick --repetitions 2 --frames 60
    """

    name: Positional[Literal["fig4"]]
    """Which study."""
    out: Out
    """Where the results go."""
    pets: Path | None = None
    """A PETS 2009 folder; its views 1, 5 and 7 are used."""
    repetitions: int = 20
    """Runs of each setting, with other seeds of the search."""
    frames: int = 200
    """Frames of each run."""

    def run(self) -> None:
        from tqdm import tqdm

        from sim import study

        for name in ("repetitions", "frames"):
            if getattr(self, name) < 1:
                raise ValueError(f"--{name} is {getattr(self, name)}, needs at least 1")
        materials = [study.synthetic(self.frames)]
        if self.pets is not None:
            materials.append(study.pets(self.pets, self.frames))
        self.out.mkdir(parents=True, exist_ok=True)
        asked, note = f"frames {self.frames}\n", self.out / "frames.txt"
        if note.is_file() and note.read_text() != asked:
            raise ValueError(f"{self.out}: holds another study ({note.read_text().strip()} there, {asked.strip()} asked for)")
        note.write_text(asked)
        total = len(materials) * self.repetitions * len(study.K_H) * len(study.I_BLS_MAX)
        for _ in tqdm(study.study(self.out, materials, self.repetitions), total=total, unit="run"):
            pass
        cells = study.read_cells(self.out / "cells.csv")
        study.draw(cells, self.out / "fig4.png")
        text = study.summary(cells)
        (self.out / "fig4.txt").write_text(text + "\n")
        print(text)
