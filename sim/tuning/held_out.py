"""The gain of the best parameters over the default ones on cases that the search has not seen, in pairs, with intervals by kind of case."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from sim.confidence_intervals import Interval, paired
from sim.parallel.pool import Pool
from sim.tuning.scoring import Candidate, score_case
from sim.tuning.search import SearchPlan
from tracker.io.resume import Journal, json_value, program_version
from tracker.parameter_file import Value

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


def try_held_out(plan: SearchPlan, best: Mapping[str, Value], kinds: Mapping[int, str], pool: Pool, progress: Any) -> HeldOut:
    """Track the cases of `kinds` with default and with best parameters. What is done is kept in the folder of the search, and continued.

    progress: wraps the iteration over runs. Raises ValueError, in one line, where a tracker fails.
    """
    default = _tried(plan, {}, kinds, pool, progress)
    return HeldOut(default, _tried(plan, best, kinds, pool, progress) if best else default, kinds, plan.figure)


def _tried(plan: SearchPlan, values: Mapping[str, Value], kinds: Mapping[int, str], pool: Pool, progress: Any) -> dict[int, dict[str, float]]:
    about = json_value({"tracker": plan.tracker, "values": dict(values), "seed": plan.source.seed, "pilsim": program_version()})
    with Journal(plan.folder / f"held-out-{'best' if values else 'default'}.jsonl", about) as journal:
        done = {int(entry["case"]): entry["figures"] for entry in journal.entries if "figures" in entry}
        left = [case for case in kinds if case not in done]
        calls = ((plan.source, case, Candidate(plan.tracker, values)) for case in left)
        for case, found in zip(left, progress(pool.results(score_case, calls), total=len(left)) if left else (), strict=True):
            if error := found.get("error"):
                raise ValueError(f"the tracker fails with its {'best' if values else 'default'} parameters: {error}")
            journal.add({"case": case, "figures": found})
            done[case] = found
    return {case: done[case] for case in kinds}
