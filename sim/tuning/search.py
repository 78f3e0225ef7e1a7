"""The search: a study of Optuna whose trials race over the cases, in processes of this machine or on a cluster, resumable at any time.

All trials run on one case after the other, in the same order. Wilcoxon's test compares a trial with the best one so far on the cases of both, and
a trial that is worse ends early. Its value is then that of the best trial, plus the mean difference on these cases.
The sampler of a trial is seeded by its number. Trials of processes that have ended are continued by others, so that a killed search with one
worker gives the same trials. Several commands may work on one folder.
"""

from __future__ import annotations

import os
import secrets
import socket
import time
import warnings
from collections import deque
from collections.abc import Iterator, Mapping
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.stats import wilcoxon

from sim.tuning.scoring import Candidate, CaseSource, objective_value, score_case, worst_mean
from sim.tuning.space import Space
from tracker.io.file_lock import Locked, file_lock
from tracker.parameter_file import Value

if TYPE_CHECKING:
    from optuna import Study
    from optuna.trial import FrozenTrial, Trial

STUDY, CLAIMS, PROCESSES = "study.db", ".claims", ".processes"
"""Names in the folder of a search: the storage, the lock under which trials are taken, and locks of the processes at work."""
WHOLE = "worst tenth"
"""Attribute of trials that were tried on all cases: the mean of their worst tenth."""
SAMPLERS = ("tpe", "cmaes")
P_WORSE, LEAST_CASES = 0.05, 8
"""A trial ends where it is worse than the best one with this p-value, after at least this number of cases."""
STARTUP_TRIALS = 12
"""Trials at random before the sampler begins, the first of which has the default parameters."""


@dataclass(frozen=True, eq=False)
class SearchPlan:
    """The description of a search.

    folder: of the study. tracker: module:function or "". space: of its parameters, and `defaults` of those that have one. source, cases: the cases
    0 to cases − 1. objective, sampler: of OBJECTIVES and SAMPLERS. seed: of the samplers. trials: number in all, None without a limit.
    seconds: after which no more is computed, None without a limit.
    """

    folder: Path
    tracker: str
    space: Space
    defaults: Mapping[str, Value]
    source: CaseSource
    cases: int
    objective: str = "hota"
    sampler: str = "tpe"
    seed: int = 0
    trials: int | None = None
    seconds: float | None = None

    @property
    def figure(self) -> str:
        return self.objective.split("-")[0]


def is_worse(objective: str, mine: list[float], theirs: list[float]) -> bool:
    """Whether scores are worse than those of another trial on the same cases: by their objective, and by Wilcoxon's signed-rank test (1945).

    A trial whose worst tenth is better thus goes on where the objective holds it, although most of its scores may be lower.
    """
    if objective_value(objective, mine) >= objective_value(objective, theirs):
        return False
    return bool(wilcoxon(mine, theirs, zero_method="zsplit", alternative="less").pvalue < P_WORSE)


@dataclass(eq=False)
class RunningTrial:
    """A trial of this process: parameters, scores by case, cases left to run, number of cases at work, and whether it has ended."""

    trial: Trial
    candidate: Candidate
    scores: dict[int, float]
    left: deque[int]
    at_work: int = 0
    ended: bool = False

    @property
    def whole(self) -> bool:
        """Whether it was tried on all cases."""
        return not self.left and not self.at_work


def open_study(plan: SearchPlan) -> Study:
    """The study of a folder, made where there is none. Raises ValueError where Optuna is missing, and for a file that is no study."""
    try:
        import optuna
        from optuna.pruners import NopPruner
        from optuna.storages import RDBStorage
    except ImportError:
        raise ValueError("tune needs Optuna: pip install 'pilsim[tune]'") from None
    optuna.logging.set_verbosity(optuna.logging.ERROR)
    warnings.filterwarnings("ignore", category=optuna.exceptions.ExperimentalWarning)
    try:
        storage = RDBStorage(f"sqlite:///{(plan.folder / STUDY).resolve()}", engine_kwargs={"connect_args": {"timeout": 120}})
        return optuna.create_study(storage=storage, pruner=NopPruner(), study_name="tune", direction="maximize", load_if_exists=True)
    except Exception as error:
        raise ValueError(f"{plan.folder / STUDY}: {' '.join(str(error).split())[:200]}") from None


def whole_trials(study: Study) -> list[FrozenTrial]:
    """The trials that were tried on all cases, the best first."""
    whole = [one for one in study.get_trials(deepcopy=False) if one.value is not None and WHOLE in one.user_attrs]
    return sorted(whole, key=lambda one: (-(one.value or 0.0), one.number))


class Search:
    """The search of this process."""

    def __init__(self, plan: SearchPlan, study: Study) -> None:
        self.plan, self.study = plan, study
        self._owner = f"{socket.gethostname()}-{os.getpid()}-{secrets.token_hex(4)}"
        self._end = None if plan.seconds is None else time.monotonic() + plan.seconds
        self._idle: list[RunningTrial] = []
        self._first: RunningTrial | None = None
        self._best = ""

    def run(self, executor: Executor, most: int, progress: Any) -> None:
        """Try trials until their number or the time is reached, `most` at once. progress: a bar of trials of tracker.io.progress.progress_bar.

        Raises ValueError where a tracker fails with its default parameters.
        """
        pending: dict[Future[dict[str, Any]], tuple[RunningTrial, int]] = {}
        with self._process_lock():
            self._show(progress)
            while True:
                while len(pending) < most and (one := self._next()) is not None:
                    one.at_work, case = one.at_work + 1, one.left.popleft()
                    pending[executor.submit(score_case, self.plan.source, case, one.candidate)] = one, case
                if not pending:
                    return
                left = None if self._end is None else max(0.0, self._end - time.monotonic())
                done = wait(pending, timeout=left, return_when=FIRST_COMPLETED).done
                if not done and left is not None:
                    return
                for future in done:
                    one, case = pending.pop(future)
                    if self._add(one, case, future.result()):
                        self._show(progress)
                    progress.set_postfix_str(f"{self._best}trial {one.trial.number}, case {case + 1}")

    def _next(self) -> RunningTrial | None:
        """An unfinished trial or a new one; None where no more are wanted."""
        if self._end is not None and time.monotonic() >= self._end:
            return None
        if self._idle:
            return self._idle.pop(0)
        # Other trials have nothing to be compared with until the first one is complete, so all workers run its cases.
        if self._first is not None and self._first.left and not self._first.ended:
            return self._first
        with file_lock(self.plan.folder / CLAIMS, wait=True):
            one = self._claimed()
        if one is not None and one.trial.number == 0:
            self._first = one
        # A kill may have come between the last score and the end of a trial.
        return self._next() if one is not None and one.scores and self._concluded(one) else one

    def _claimed(self) -> RunningTrial | None:
        """A trial that nobody works on, or a new one."""
        import optuna

        trials = self.study.get_trials(deepcopy=False)
        for one in trials:
            if one.state.name == "RUNNING" and not self._at_work(one):
                self._set_sampler(one.number)
                # Optuna samples what a trial lacks when it is opened.
                return self._begun(optuna.trial.Trial(self.study, one._trial_id))
        number = next((one.number for one in trials if one.state.name == "WAITING"), len(trials))
        if self.plan.trials is not None and number >= self.plan.trials:
            return None
        if number == len(trials) and number < STARTUP_TRIALS:
            self.study.enqueue_trial(self._first_values(number))
        self._set_sampler(number)
        return self._begun(self.study.ask())

    def _first_values(self, number: int) -> dict[str, Value]:
        """Parameters of an early trial: the default ones for trial 0 where all are known and in the space, otherwise random ones."""
        space, defaults = self.plan.space, self.plan.defaults
        if number == 0 and all(one.name in defaults and one.holds(defaults[one.name]) for one in space):
            return {one.name: defaults[one.name] for one in space}
        rng = np.random.default_rng([self.plan.seed, number, 1])
        return {one.name: one.draw(rng) for one in space}

    def _set_sampler(self, number: int) -> None:
        from optuna.samplers import CmaEsSampler, RandomSampler, TPESampler

        seed = int(np.random.default_rng([self.plan.seed, number]).integers(1 << 31))
        if self.plan.sampler == "cmaes":
            self.study.sampler = CmaEsSampler(seed=seed, independent_sampler=RandomSampler(seed), warn_independent_sampling=False)
        else:
            self.study.sampler = TPESampler(n_startup_trials=1, multivariate=True, seed=seed)

    def _begun(self, trial: Trial) -> RunningTrial:
        trial.set_user_attr("owner", self._owner)
        values = {one.name: one.suggest(trial) for one in self.plan.space}
        known = self.study.get_trials(deepcopy=False)[trial.number]
        scores = {step: value for step, value in known.intermediate_values.items() if value == value}
        return RunningTrial(trial, Candidate(self.plan.tracker, values), scores, deque(k for k in range(self.plan.cases) if k not in scores))

    def _add(self, one: RunningTrial, case: int, result: dict[str, Any]) -> bool:
        """Record a score of a trial, and end the trial where it is complete, worse, or has failed. Returns whether it has ended."""
        one.at_work -= 1
        if one.ended:
            return False
        error = result.get("error", "")
        score = np.nan if error else float(result[self.plan.figure])
        # In a case in which nobody counts, there is no score.
        if score == score:
            one.scores[case] = score
            one.trial.report(score, case)
        if self._concluded(one, error):
            return True
        if one is not self._first:
            self._idle.append(one)
        return False

    def _concluded(self, one: RunningTrial, error: str = "") -> bool:
        """End a trial where it has failed, is worse than the best one, or was tried on all cases. Returns whether it has ended."""
        if error:
            self._fail(one, error)
        elif not one.whole:
            if not self._end_early(one):
                return False
        elif one.scores:
            scores = list(one.scores.values())
            one.trial.set_user_attr(WHOLE, worst_mean(scores))
            self.study.tell(one.trial, objective_value(self.plan.objective, scores))
        else:
            self._fail(one, "nobody counts in any case")
        one.ended = True
        return True

    def _end_early(self, one: RunningTrial) -> bool:
        """End a trial that is worse than the best one, on the cases of both. Returns whether it is."""
        whole = whole_trials(self.study)
        if not whole:
            return False
        best = whole[0]
        common = sorted(set(one.scores) & set(best.intermediate_values))
        mine, theirs = ([values[case] for case in common] for values in (one.scores, best.intermediate_values))
        if len(common) < LEAST_CASES or not is_worse(self.plan.objective, mine, theirs):
            return False
        self.study.tell(one.trial, float(best.value or 0.0) + min(float(np.mean(np.subtract(mine, theirs))), 0.0))
        return True

    def _fail(self, one: RunningTrial, error: str) -> None:
        import optuna

        # The trial is left open: after a repair, the same command continues it.
        if all(self.plan.defaults.get(name) == value for name, value in one.candidate.values.items()):
            raise ValueError(f"the tracker fails with its default parameters: {error}")
        one.trial.set_user_attr("error", error)
        self.study.tell(one.trial, state=optuna.trial.TrialState.FAIL)

    def _show(self, progress: Any) -> None:
        trials = self.study.get_trials(deepcopy=False)
        progress.n = sum(one.state.is_finished() for one in trials)
        values = [one.value for one in trials if one.value is not None]
        self._best = f"best {max(values):.4f}, " if values else ""
        progress.refresh()

    @contextmanager
    def _process_lock(self) -> Iterator[None]:
        """Show other processes that this one is at work."""
        folder = self.plan.folder / PROCESSES
        folder.mkdir(exist_ok=True)
        with file_lock(folder / self._owner):
            yield

    def _at_work(self, trial: FrozenTrial) -> bool:
        """Whether the process of a running trial is alive."""
        owner = trial.user_attrs.get("owner")
        if owner == self._owner:
            return True
        path = self.plan.folder / PROCESSES / str(owner)
        if not path.exists():
            return False
        try:
            with file_lock(path):
                return False
        except Locked:
            return True


def at_work(plan: SearchPlan, study: Study) -> int:
    """Number of trials that other processes work on."""
    search = Search(plan, study)
    return sum(one.state.name == "RUNNING" and search._at_work(one) for one in study.get_trials(deepcopy=False))
