"""A whole run of `pilsim tune`: cases, search, gain on other cases, and the files of its result."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Executor
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

from sim.confidence_intervals import Interval, paired
from sim.parallel.pool import Pool, ended, losses
from sim.tuning.case_file import VERSION
from sim.tuning.scoring import FIGURES, Candidate, draw_case, score_case, worst_mean
from sim.tuning.search import CLAIMS, STUDY, WHOLE, Search, SearchPlan, at_work, open_study, whole_trials
from tracker.io.atomic import write_text
from tracker.io.file_lock import file_lock, folder_lock
from tracker.io.json_files import json_text, read_json
from tracker.io.progress import progress_bar
from tracker.io.resume import Journal, check_same, holds_run, json_value, program_version
from tracker.parameter_file import Value, parameters_text

if TYPE_CHECKING:
    from optuna import Study
    from optuna.trial import FrozenTrial

RUN, BEST, RESULT = "run.json", "best.toml", "result.json"
Workers = tuple[Executor, int]
ALL = "all"
"""Name of the gain on the cases of all kinds."""


@dataclass(frozen=True, eq=False)
class HeldOut:
    """Figures of both trackers by case: default, best. kinds: case → kind. figure: the figure of the gains.

    errors: a line for each case in which a tracker failed; its figures are NaN.
    """

    default: Mapping[int, Mapping[str, float]]
    best: Mapping[int, Mapping[str, float]]
    kinds: Mapping[int, str]
    figure: str
    errors: tuple[str, ...] = ()

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

    def worst_tenths(self) -> tuple[float, float]:
        """Means of the worst tenth of the cases with the default and with the best parameters; NaN where no case counts for both."""
        both = [(d, b) for case in self.kinds if (d := self.default[case][self.figure]) == d and (b := self.best[case][self.figure]) == b]
        default, best = ([pair[k] for pair in both] for k in (0, 1))
        return (worst_mean(default), worst_mean(best)) if both else (math.nan, math.nan)


def held_out_cases(plan: SearchPlan, count: int) -> range:
    """The cases that follow those of the search."""
    return range(plan.cases, plan.cases + count)


def try_held_out(plan: SearchPlan, best: Mapping[str, Value], kinds: Mapping[int, str], workers: Workers, progress: Any) -> HeldOut:
    """Track the cases of `kinds` with default and with best parameters ({} where the default is best). Finished runs are kept in the folder.

    workers: an executor, and how many calls it takes at once. progress: wraps the iteration over runs.
    A run in which a tracker fails has an error in the result, and is repeated by the same command.
    """
    wanted = {"default": dict[str, Value](), **({"best": dict(best)} if best else {})}
    figures, errors = {name: dict[int, dict[str, float]]() for name in wanted}, list[str]()
    with ExitStack() as stack:
        journals = {name: stack.enter_context(Journal(plan.folder / f"held-out-{name}.jsonl", _about(plan, of))) for name, of in wanted.items()}
        for name, journal in journals.items():
            figures[name] |= {int(entry["case"]): entry["figures"] for entry in journal.entries if "figures" in entry}
        left = [(name, case) for case in kinds for name in wanted if case not in figures[name]]
        calls = ((plan.source, case, Candidate(plan.tracker, wanted[name])) for name, case in left)
        for number, found in progress(ended(*workers, score_case, calls), total=len(left)) if left else ():
            name, case = left[number]
            if error := found.get("error"):
                errors.append(f"{name} parameters: {error}")
                figures[name][case] = dict.fromkeys(FIGURES, math.nan)
                continue
            journals[name].add({"case": case, "figures": found})
            figures[name][case] = found
    default, chosen = figures["default"], figures["best" if best else "default"]
    return HeldOut({case: default[case] for case in kinds}, {case: chosen[case] for case in kinds}, kinds, plan.figure, tuple(sorted(errors)))


def _about(plan: SearchPlan, values: Mapping[str, Value]) -> dict[str, Any]:
    return dict(json_value(_program(plan) | {"values": values, "seed": plan.source.seed}))


def _program(plan: SearchPlan) -> dict[str, Any]:
    """The tracker with what its scores depend on beside the cases and the parameters of a trial."""
    return {"tracker": plan.tracker, "defaults": plan.defaults, "pilsim": program_version()}


@dataclass(frozen=True, eq=False)
class TunedResult:
    """The result of a search.

    best: parameters of the best whole trial. number, value: its number and objective. worst: mean of its worst tenth.
    trials, early, failed: numbers of trials in all, of those that ended early, and of those that failed.
    errors: a line for each failed trial, and for each other case in which a tracker failed.
    curve: number of each whole trial and the best objective until then. slices: parameters and objective of each trial.
    importance: shares by parameter, {} where there are too few trials. held_out: None where no other cases were asked for.
    default_value, default_worst: objective and worst tenth of the default parameters, NaN where they are not all known or not in the space.
    """

    best: Mapping[str, Value]
    number: int
    value: float
    worst: float
    trials: int
    early: int
    failed: int
    errors: tuple[str, ...]
    curve: tuple[tuple[int, float], ...]
    slices: tuple[tuple[dict[str, Any], float], ...]
    importance: Mapping[str, float]
    held_out: HeldOut | None
    default_value: float = math.nan
    default_worst: float = math.nan

    def to_dict(self) -> dict[str, Any]:
        """As JSON values."""
        gains = {} if self.held_out is None else {kind: vars(gain) | {"verdict": gain.verdict} for kind, gain in self.held_out.gains().items()}
        names = ("number", "value", "worst", "default_value", "default_worst", "trials", "early", "failed")
        tenths = {} if self.held_out is None else dict(zip(("default", "best"), self.held_out.worst_tenths(), strict=True))
        found = {"importance": dict(self.importance), "gains": gains, "worst_tenths": tenths}
        return {"best": dict(self.best)} | {name: getattr(self, name) for name in names} | found


def tune(plan: SearchPlan, held_out: int, pool: Pool, quiet: bool = False) -> TunedResult | int:
    """Draw the cases, search, try the best parameters on `held_out` other cases, and write best.toml and result.json.

    Returns the number of trials that other processes still work on, where there are some: the last one writes the result.
    Raises ValueError, in one line, for a folder of another search, and where nothing was found.
    """
    numbers = [*range(plan.cases), *held_out_cases(plan, held_out)]
    plan.folder.mkdir(parents=True, exist_ok=True)
    with _statement(plan):
        study = open_study(plan)
    bar = partial(progress_bar, leave=False, disable=quiet)
    with losses(), pool.executor() as workers:
        _draw(plan, numbers, workers, partial(bar, desc="cases", unit="case"))
        with bar(desc="trials", unit="trial", total=plan.trials) as shown:
            Search(plan, study).run(*workers, shown)
    if left := at_work(plan, study):
        return left
    kinds = {case: plan.source.kind(case) for case in held_out_cases(plan, held_out)}
    # At the end of the time, runs of the search may still occupy its workers.
    with losses(), pool.executor() as workers, folder_lock(plan.folder):
        return _finished(plan, study, kinds, workers, partial(bar, desc="other cases", unit="run"))


@contextmanager
def _statement(plan: SearchPlan) -> Iterator[None]:
    """Write the description of the search into the folder, locked. Raises ValueError for a folder of another search."""
    about = json_value({
        "tune": VERSION,
        **_program(plan),
        "space": plan.space,
        "objective": plan.objective,
        "sampler": plan.sampler,
        "seed": plan.seed,
        "population": {"cases": plan.cases, "seed": plan.source.seed, "source": plan.source.name},
    })  # fmt: skip
    with file_lock(plan.folder / CLAIMS, wait=True):
        if holds_run(plan.folder, RUN, (STUDY, ".*", "cases")):
            check_same(plan.folder, read_json(plan.folder / RUN), about, "another search")
        else:
            write_text(plan.folder / RUN, json_text(about, indent=1) + "\n")
        yield


def _draw(plan: SearchPlan, numbers: list[int], workers: Workers, progress: Callable[..., Any]) -> None:
    """Draw the cases that are missing. Raises ValueError, before, for a folder of cases of another version."""
    folder = plan.source.folder
    folder.mkdir(parents=True, exist_ok=True)
    # Searches that share the cases draw them one after the other.
    with file_lock(folder / CLAIMS, wait=True):
        missing = [number for number in numbers if not plan.source.path(number).is_file()]
        if there := sorted(set(numbers) - set(missing)):
            plan.source.case(there[0])
        if missing:
            for _ in progress(ended(*workers, draw_case, ((plan.source, number) for number in missing)), total=len(missing)):
                pass


def _finished(plan: SearchPlan, study: Study, kinds: Mapping[int, str], workers: Workers, progress: Callable[..., Any]) -> TunedResult:
    trials = study.get_trials(deepcopy=False)
    whole = whole_trials(study)
    failed = [one for one in trials if one.state.name == "FAIL"]
    if not whole:
        reason = f"; {len(failed)} failed, the first: {failed[0].user_attrs.get('error')}" if failed else ""
        raise ValueError(f"{plan.folder}: no trial has tried all cases yet{reason}; the same command goes on")
    best = whole[0]
    started = _is_default(plan, best)
    tried = None if not kinds else try_held_out(plan, {} if started else best.params, kinds, workers, progress)
    scored = [one for one in trials if one.value is not None]
    default = next((one for one in whole if _is_default(plan, one)), None)
    result = TunedResult(
        best.params,
        best.number,
        float(best.value or 0.0),
        float(best.user_attrs[WHOLE]),
        sum(one.state.is_finished() for one in trials),
        len(scored) - len(whole),
        len(failed),
        (*(f"trial {one.number}: {one.user_attrs.get('error')}" for one in failed), *(() if tried is None else tried.errors)),
        _curve(whole),
        tuple((one.params, float(one.value or 0.0)) for one in scored),
        _importance(study, scored),
        tried,
        math.nan if default is None else float(default.value or 0.0),
        math.nan if default is None else float(default.user_attrs[WHOLE]),
    )
    comments = (
        f"pilsim tune: trial {best.number} of {result.trials}, {plan.objective} {best.value:.4f} on {plan.cases} cases of seed {plan.source.seed}",
        f"tracker: {plan.tracker or 'default'}",
        *([] if tried is None else [gain_text(tried)]),
    )
    write_text(plan.folder / BEST, parameters_text(best.params, comments))
    write_text(plan.folder / RESULT, json_text(result.to_dict(), indent=1) + "\n")
    return result


def gain_text(tried: HeldOut) -> str:
    """A sentence on the gain on other cases."""
    gain = tried.gains().get(ALL)
    if gain is None:
        return "no other case counts"
    text = f"gain of {tried.figure} on {len(tried.kinds)} other cases: {gain.text(4, signed=True)}"
    verdict = {"higher": "", "lower": ": a loss"}.get(gain.verdict, ": none is seen")
    before, after = tried.worst_tenths()
    return f"{text}{verdict}; worst tenth {before:.4f} → {after:.4f}"


def _is_default(plan: SearchPlan, trial: FrozenTrial) -> bool:
    return all(plan.defaults.get(name) == value for name, value in trial.params.items())


def _curve(whole: list[FrozenTrial]) -> tuple[tuple[int, float], ...]:
    out, best = [], -math.inf
    for one in sorted(whole, key=lambda one: one.number):
        best = max(best, float(one.value or 0.0))
        out.append((one.number, best))
    return tuple(out)


def _importance(study: Study, scored: list[FrozenTrial]) -> dict[str, float]:
    """Shares of the variance of the objective by parameter (fANOVA, Hutter et al. 2014); {} where trials are too few or alike."""
    from optuna.importance import FanovaImportanceEvaluator, get_param_importances

    if len(scored) < 8 or len({one.value for one in scored}) < 2:
        return {}
    try:
        found = get_param_importances(study, evaluator=FanovaImportanceEvaluator(seed=0))
    except ImportError:
        raise ValueError("importance of parameters needs scikit-learn: pip install 'pilsim[tune]'") from None
    except (ValueError, RuntimeError):
        return {}
    return {name: round(float(share), 4) for name, share in found.items()}
