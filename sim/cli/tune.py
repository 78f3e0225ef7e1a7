"""The command `pilsim tune`: choose parameters of a tracker on a population of synthetic cases, or for your own cameras."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from tyro.conf import OmitArgPrefixes, Positional, arg

from sim.cli.options import Out, command_line, json_text, unset
from sim.cli.track import SourcePart
from tracker.options import Least

if TYPE_CHECKING:
    from sim.tuning.search import SearchPlan
    from sim.tuning.tuned import TunedResult


@dataclass(frozen=True)
class Tune:
    """Choose the parameters of a tracker, without annotations.

    Synthetic cases are drawn once: rooms, halls, squares and outdoor worlds, their
    cameras and people, and detectors with errors like real ones. Trials of parameters
    race: a clearly worse trial ends early. With SOURCE, the cases have your cameras, and
    the errors of your detector where the recording has truth; else, give --people.
    The best and the default parameters are then compared on other cases.

    The same command continues a search that was interrupted, and several commands in
    one folder share it. best.toml is for --parameters of track, stress and predict.

    Examples: pilsim tune --trials 100 --workers 2 --out runs/tune
              pilsim tune --time 60 --population 200 --seed 1 --out runs/tune
              pilsim tune my-cameras --people 12 --trials 60 --out runs/mine
              pilsim tune --tracker mine:track --space mine.toml --trials 50 --out runs/theirs
              pilsim tune --trials 500 --cluster tcp://10.0.0.1:8786 --out /shared/tune
    """

    out: Out
    """Folder of the search: study.db (Optuna), cases, best.toml, result.json and index.html."""
    source: Positional[Annotated[Path | None, unset("[SOURCE]", "the population")]] = None
    """A recording whose fixed cameras are used, with or without truth and detections."""
    tracker: Annotated[str, unset("MODULE:FUNCTION", "default, pilsim's own")] = ""
    """A tracker of your own: a function of (setup, ticks) whose keyword arguments are the parameters."""
    space: Annotated[Path | None, unset("FILE.toml", "that of pilsim's own tracker")] = None
    """Parameters with their ranges: [NAME] with range = [LOW, HIGH] and log = true, or with choices = [...]."""
    objective: Literal["hota", "mota", "idf1", "hota-worst", "mota-worst", "idf1-worst"] = "hota"
    """The mean of this figure over the cases is maximized; with -worst, the average of that mean and of the mean of the worst tenth."""
    sampler: Literal["tpe", "cmaes"] = "tpe"
    """Sampler of Optuna: tree-structured Parzen estimator, or CMA-ES."""
    population: Annotated[int, Least(2)] = 200
    """Number of cases of the search."""
    held_out: Annotated[int, Least(0)] = 100
    """Number of other cases on which the best and the default parameters are compared; 0 for none."""
    seed: Annotated[int, Least(0)] = 0
    """Seed of the cases and of the sampler."""
    trials: Annotated[int | None, Least(1), unset("INT", "100 without --time")] = None
    """Number of trials, those of earlier runs included."""
    time: Annotated[float | None, unset("MINUTES", "no limit")] = None
    """Time of the search, without drawing cases and testing the best parameters."""
    people: Annotated[int | None, unset("INT", "as in the truth of SOURCE")] = None
    """Mean number of people at once before the cameras of SOURCE."""
    cases: Annotated[Path | None, unset("DIR", "in --out")] = None
    """Folder of the cases, which several searches may share."""
    workers: Annotated[int, Least(1)] = 1
    """Number of processes. With one, a search gives the same trials again."""
    cluster: Annotated[str | None, unset("ADDRESS", "this machine alone")] = None
    """Address of a Dask scheduler, as tcp://10.0.0.1:8786, in place of this machine; its workers must see the folders under the same paths."""
    json: bool = False
    """Print JSON alone."""
    part: Annotated[OmitArgPrefixes[SourcePart], arg(name="source")] = SourcePart()
    """These options choose what of SOURCE is read; detectors are fitted to these frames."""

    def run(self) -> None:
        from sim.parallel.pool import Pool
        from sim.report.tuning_page import write_tuning_page
        from sim.tuning.tuned import tune

        plan = self._plan()
        found = tune(plan, self.held_out, Pool(self.workers, self.cluster), self.json)
        if isinstance(found, int):
            print(f"{self.out}: other processes work on {found} trial{'s' * (found != 1)}; the last one writes the result")
            return
        page = write_tuning_page(plan, found, command_line(self, ("workers", "cluster", "json"), repeated=("detections",)))
        if self.json:
            print(json_text(found.to_dict(), indent=1))
            return
        print("\n".join(_lines(plan, found)))
        use = "has the keyword arguments" if plan.tracker else "is for --parameters, as in `pilsim track SOURCE --parameters`"
        print(f"{page}: the page; {self.out / 'best.toml'} {use}")

    def _plan(self) -> SearchPlan:
        from sim.stress.tracker_under_test import load_tracker
        from sim.tuning.scoring import CaseSource
        from sim.tuning.search import SearchPlan
        from sim.tuning.space import OWN_SPACE, function_defaults, own_defaults, read_space

        if self.time is not None and not 0 < self.time < 1e6:
            raise ValueError(f"--time is {self.time}, needs minutes, more than 0")
        tracker = "" if self.tracker == "default" else self.tracker
        if tracker and self.space is None:
            raise ValueError("--tracker needs --space, a file of its parameters with their ranges")
        if self.source is None and (self.people is not None or self.part != SourcePart()):
            raise ValueError("--people and options of a source need SOURCE")
        path = self.space or OWN_SPACE
        space = read_space(path)
        defaults = function_defaults(load_tracker(tracker), space, str(path)) if tracker else own_defaults(space, str(path))
        user = None
        if self.source is not None:
            from sim.tuning.population import open_cameras
            from tracker.formats.source_options import SourceOptions

            part = SourceOptions.parse(self.part.detections, "", 0, self.part.cameras, self.part.frames)
            user = open_cameras(self.source, part, self.people)
        source = CaseSource((self.cases or self.out / "cases").resolve(), self.seed, user)
        trials = 100 if self.trials is None and self.time is None else self.trials
        seconds = None if self.time is None else 60 * self.time
        return SearchPlan(self.out, tracker, space, defaults, source, self.population, self.objective, self.sampler, self.seed, trials, seconds)


def _lines(plan: SearchPlan, found: TunedResult) -> list[str]:
    """The result as a few lines."""
    from sim.tuning.tuned import gain_text

    worse = f"{found.early} ended early as worse, {found.failed} failed"
    known = found.default_value == found.default_value
    default, worst = (f" (default {value:.4f})" if known else "" for value in (found.default_value, found.default_worst))
    out = [
        f"{plan.folder}: {found.trials} trials on {plan.cases} cases; {worse}",
        f"best: trial {found.number}, {plan.objective} {found.value:.4f}{default}; mean of the worst tenth {found.worst:.4f}{worst}",
    ]
    out += [f"  {name} = {value}" for name, value in found.best.items()]
    if found.held_out is not None:
        out.append(gain_text(found.held_out))
    out += [f"failed: {error}" for error in found.errors[:5]]
    return out + ([f"and {len(found.errors) - 5} more failed"] if len(found.errors) > 5 else [])
