"""Where the tracker breaks."""

from __future__ import annotations

import json
import shlex
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from tyro.conf import arg

from sim.commands.options import unset

if TYPE_CHECKING:
    from sim.contender import Contender
    from sim.stress import Case
    from sim.trial import Trial


@dataclass(frozen=True)
class Stress:
    """Try a tracker on sweeps, each of one parameter: more people, rougher ground, views that drop out, slipping wheels and so on.

    A line a run in DIR/results.jsonl: scores, what was possible at all, why people were missed or mixed up, pictures of the worst moments. The same
    command again goes on where it was interrupted. `--list` shows the sweeps; robots/2 is the run that all of them start from.
    --slam, --iterations, --correction and --hypotheses are the tracker's, of every run: two trackers that are to be compared get a folder each.

    Examples: pilsim stress --sweep density --seeds 5 --no-render --workers 2 --out runs/density
              pilsim stress --sweep placement --seeds 5 --no-render --out runs/placement
              pilsim stress --sweep density filter --ladder --workers 2 --out runs/two
              pilsim stress --sweep robots/2 --slam ekf --correction off --seeds 20 --no-render --out runs/ekf
              pilsim stress --pets data/pets2009/S2.L1 --out runs/pets
              pilsim stress --sweep misses --tracker mine:track --out runs/mine
    """

    out: Annotated[Path | None, unset("DIR", "needed, but for --list")] = None
    """Where the results go."""
    sweep: Annotated[tuple[str, ...], arg(help_behavior_hint="(default: all)")] = ()
    """Which sweeps, or single cases of them as in density/3."""
    show: Annotated[bool, arg(name="list")] = False
    """Show the sweeps and do nothing."""
    json: bool = False
    """With --list: every case as a line of JSON, with its scenario. Else: the rows, when all are there."""
    seeds: int = 1
    """How many seeds of each case."""
    first_seed: int = 0
    """The first of them."""
    frames: int = 60
    """Frames of a run (of the sweep over the rate: at 6 frames a second)."""
    width: int = 512
    """Of a panorama in pixels."""
    world: str = "pilsun"
    """Where, unless the sweep says otherwise."""
    render: bool = True
    """With panoramas and their features, as a real robot; --no-render: boxes and landmarks by rays, many times faster."""
    ladder: bool = False
    """Run each case with stages replaced by the truth, all 16 combinations, and share out the loss between them."""
    pets: Annotated[Path | None, unset("DIR", "none")] = None
    """A PETS 2009 sequence (as for `pilsim track`): it and its twin are run too, or alone where no sweep is named."""
    tracker: Annotated[str, unset("MODULE:FUNCTION", "pilsim's own")] = ""
    """Called with (setup, ticks), giving an Estimate a tick as tracker.pipeline.track does."""
    results: Annotated[Path | None, unset("DIR", "none")] = None
    """Tracks that were made elsewhere in place of a tracker: FOLDER/ID/SEED.txt, as in density/3/4.txt, MOT15 with x, y, z."""
    slam: Annotated[Literal["ekf", "iekf", "fej", "invariant"] | None, unset("{ekf,iekf,fej,invariant}", "fej")] = None
    """The filter of the robots' places, as for `pilsim track`; a sweep over it goes first. So with what follows."""
    iterations: Annotated[int | None, unset("INT", "2")] = None
    """Linearisations of an update."""
    correction: Annotated[Literal["on", "off"] | None, unset("{on,off}", "on")] = None
    """Whether each robot's correction factor is estimated."""
    hypotheses: Annotated[Literal["single", "multiple"] | None, unset("{single,multiple}", "single")] = None
    """How people are followed."""
    workers: int = 1
    """Processes at work at once."""
    cluster: Annotated[str | None, unset("ADDRESS", "this machine alone")] = None
    """A Dask scheduler, as in tcp://10.0.0.1:8786, to use instead; its workers must see DIR under the same path."""
    limit: float = 1800.0
    """Seconds after which a run is ended."""

    def run(self) -> None:
        from functools import partial

        from tqdm import tqdm

        from sim.sweep import Force, sweep
        from worlds.catalogue import WORLDS

        if self.show:
            self._show()
            return
        if self.out is None:
            raise ValueError("--out is missing, needs a folder for the results")
        for name, least in (("seeds", 1), ("first_seed", 0), ("frames", 2)):
            if getattr(self, name) < least:
                raise ValueError(f"--{name.replace('_', '-')} is {getattr(self, name)}, needs at least {least}")
        if self.world not in WORLDS:
            raise ValueError(f"--world is {self.world!r}, needs one of {', '.join(sorted(WORLDS))}")
        force, trials = Force(self.workers, self.cluster, self.limit), self._trials()
        rows = sweep(trials, self.out, force, self._command(), partial(tqdm, desc="runs", unit="run", smoothing=0.1))
        if self.json:
            for row in rows:
                print(json.dumps(row))
            return
        failed = [row for row in rows if row["error"]]
        print(f"{self.out}: {len(rows)} runs in results.jsonl; `pilsim report {self.out}` makes a page of them")
        for row in failed[:10]:
            print(f"failed: {row['id']} seed {row['seed']}: {row['error']}")
        if len(failed) > 10:
            print(f"and {len(failed) - 10} more")

    def _cases(self) -> list[Case]:
        from sim.stress import cases, pets_cases, standard

        if self.pets is not None and not self.pets.is_dir():
            raise ValueError(f"{self.pets}: no such folder")
        start = replace(standard(self.frames, self.width), world=self.world)
        alone = self.pets is not None and not self.sweep
        chosen = [] if alone else cases(self.sweep, start)
        return chosen + ([] if self.pets is None else pets_cases(str(self.pets.resolve()), start))

    def _contender(self) -> Contender:
        from sim.contender import Contender, load

        names = ("slam", "iterations", "correction", "hypotheses")
        options = {name: value for name in names if (value := getattr(self, name)) is not None}
        if self.results is not None and not self.results.is_dir():
            raise ValueError(f"{self.results}: no such folder")
        if self.tracker:
            load(self.tracker)
        return Contender(self.tracker, options, "" if self.results is None else str(self.results.resolve()))

    def _trials(self) -> list[Trial]:
        """Seed by seed, so that an interrupted sweep has whole curves."""
        from sim.trial import Trial

        assert self.out is not None
        contender, out, made = self._contender(), self.out.resolve(), []
        for seed in range(self.first_seed, self.first_seed + self.seeds):
            for case in self._cases():
                # What is real is the same for every seed.
                if case.source != "pets" or seed == self.first_seed:
                    command = self._command(replace(self, sweep=(case.id,), seeds=1, first_seed=seed, workers=1))
                    made.append(Trial(case.of_seed(seed), contender, out, self.render, self.ladder, command))
        return made

    def _show(self) -> None:
        from sim.stress import SWEEPS

        if self.json:
            for case in self._cases():
                print(case.to_json())
            return
        for sweep in SWEEPS.values():
            values = ", ".join(map(str, sweep.values)) if not isinstance(sweep.values[0], str) else "; ".join(map(str, sweep.values))
            print(f"{sweep.name:12} {sweep.about}\n{'':12} {sweep.parameter}{f' ({sweep.unit})' if sweep.unit else ''}: {values}")

    def _command(self, other: Stress | None = None) -> str:
        """The command line that asks for this."""
        now, words = other or self, ["pilsim", "stress"]
        for name, field in Stress.__dataclass_fields__.items():
            value: Any = getattr(now, name)
            if value == field.default or name in ("show", "json"):
                continue
            flag = f"--{name.replace('_', '-')}"
            if name == "sweep":
                words += [flag, *value]
            elif isinstance(value, bool):
                words.append(flag if value else f"--no-{name}")
            else:
                words += [flag, str(value)]
        return shlex.join(words)
