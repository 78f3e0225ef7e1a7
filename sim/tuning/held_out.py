"""The gain of the best parameters over the default ones on other cases than those of the search: paired, with intervals by kind."""

from __future__ import annotations

from collections.abc import Mapping
from concurrent.futures import Executor
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any

from sim.confidence_intervals import Interval, paired
from sim.parallel.pool import ended
from sim.tuning.scoring import Candidate, score_case
from sim.tuning.search import SearchPlan
from tracker.io.resume import Journal, json_value, program_version
from tracker.parameter_file import Value

Workers = tuple[Executor, int]
ALL = "all"
"""Name of the gain on the cases of all kinds."""


@dataclass(frozen=True, eq=False)
class HeldOut:
    """Figures of both trackers by case: default, best. kinds: case → kind. figure: of which gains are."""

    default: Mapping[int, Mapping[str, float]]
    best: Mapping[int, Mapping[str, float]]
    kinds: Mapping[int, str]
    figure: str

    def gains(self) -> dict[str, Interval]:
        """Best less default of the figure: of all cases, then by kind, with intervals of 95 %; kinds without cases that count are left out."""
        out = {}
        for kind in (ALL, *sorted(set(self.kinds.values()))):
            chosen = [case for case, of in self.kinds.items() if kind in (ALL, of)]
            values = [{k: v for k in chosen if (v := one[k][self.figure]) == v} for one in (self.default, self.best)]
            if (gain := paired(values[0], values[1])) is not None:
                out[kind] = gain
        return out

    def worst(self, count: int = 10) -> list[int]:
        """The cases in which the best parameters have the lowest figure."""
        counted = [case for case in self.kinds if self.best[case][self.figure] == self.best[case][self.figure]]
        return sorted(counted, key=lambda case: self.best[case][self.figure])[:count]


def held_out_cases(plan: SearchPlan, count: int) -> range:
    """The cases that follow those of the search."""
    return range(plan.cases, plan.cases + count)


def try_held_out(plan: SearchPlan, best: Mapping[str, Value], kinds: Mapping[int, str], workers: Workers, progress: Any) -> HeldOut:
    """Track the cases of `kinds` with default and with best parameters, {} for the default ones. What is done is kept in the folder, and continued.

    workers: an executor, and how many calls it takes at once. progress: wraps the iteration over runs.
    Raises ValueError, in one line, where a tracker fails.
    """
    wanted = {"default": dict[str, Value](), **({"best": dict(best)} if best else {})}
    figures = {name: dict[int, dict[str, float]]() for name in wanted}
    with ExitStack() as stack:
        journals = {name: stack.enter_context(Journal(plan.folder / f"held-out-{name}.jsonl", _about(plan, of))) for name, of in wanted.items()}
        for name, journal in journals.items():
            figures[name] |= {int(entry["case"]): entry["figures"] for entry in journal.entries if "figures" in entry}
        left = [(name, case) for case in kinds for name in wanted if case not in figures[name]]
        calls = ((plan.source, case, Candidate(plan.tracker, wanted[name])) for name, case in left)
        for number, found in progress(ended(*workers, score_case, calls), total=len(left)) if left else ():
            name, case = left[number]
            if error := found.get("error"):
                raise ValueError(f"the tracker fails with its {name} parameters: {error}")
            journals[name].add({"case": case, "figures": found})
            figures[name][case] = found
    default, chosen = figures["default"], figures["best" if best else "default"]
    return HeldOut({case: default[case] for case in kinds}, {case: chosen[case] for case in kinds}, kinds, plan.figure)


def _about(plan: SearchPlan, values: Mapping[str, Value]) -> dict[str, Any]:
    return dict(json_value({"tracker": plan.tracker, "values": values, "seed": plan.source.seed, "pilsim": program_version()}))
