"""Scores of a tracker on a synthetic case, on the ground: HOTA, MOTA, IDF1 and their parts. An error is reported in one line."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from sim.stress.tracker_under_test import check_estimates, load_tracker
from sim.tuning.case_file import PopulationCase, case_path
from sim.tuning.population import KIND, UserCameras, kind_of, population_case, user_case
from tracker.metrics.clear_mot import score
from tracker.metrics.evaluation import matching_frames
from tracker.parameter_file import Value, with_fields
from tracker.pipeline import Parameters, track
from tracker.sequence.results import Results
from tracker.types import Estimate, Setup, Tick
from tracker.types.truth import evaluated_people

Track = Callable[[Setup, Iterable[Tick]], Iterable[Estimate]]
FIGURES = ("hota", "mota", "idf1", "misses", "false_positives", "switches", "motp_m", "truths")
WORST = 0.1
"""Share of the worst cases in the objectives with -worst."""
OBJECTIVES = ("hota", "mota", "idf1", "hota-worst", "mota-worst", "idf1-worst")
"""Mean of a figure over the cases; with -worst, the mean of that and of the mean of the worst tenth."""


@dataclass(frozen=True)
class CaseSource:
    """Where cases come from: the folder that keeps them, their seed, and the user's cameras, None for the population."""

    folder: Path
    seed: int
    user: UserCameras | None = None

    def case(self, number: int) -> PopulationCase:
        """Case `number`, from its file or drawn. Raises ValueError for a file of another version."""
        return population_case(number, self.seed, self.folder) if self.user is None else user_case(number, self.seed, self.folder, self.user)

    def path(self, number: int) -> Path:
        """The file of a case."""
        return case_path(self.folder, number, self.seed, "" if self.user is None else self.user.key)

    @property
    def name(self) -> str:
        """The cameras of a user and their checksum; empty for the population."""
        return "" if self.user is None else f"{self.user.name}, {self.user.key}"

    def kind(self, number: int) -> str:
        """The kind of a case."""
        return kind_of(number, self.seed) if self.user is None else KIND


@dataclass(frozen=True)
class Candidate:
    """A tracker with parameters: function is module:function with keyword arguments, or "" for pilsim's own with fields by path."""

    function: str = ""
    values: Mapping[str, Value] = field(default_factory=dict)


def evaluate(case: PopulationCase, tracker: Track | Parameters | None = None) -> dict[str, float]:
    """Track a case and score it as `pilsim score` does, with distances of at most 1 m: figures by FIGURES, and `seconds` of processor time.

    tracker: a function like tracker.pipeline.track, or parameters of pilsim's own tracker, which then has the delay of the case.
    People whom no camera sees do not count. A case in which nobody counts has figures of NaN.
    Raises the errors of the tracker, and ValueError where its estimates are not valid.
    """
    sequence = case.recording.sequence()
    assert sequence.truth is not None
    ticks, began = list(sequence.ticks), time.process_time()
    if tracker is None or isinstance(tracker, Parameters):
        estimates = track(sequence.setup, ticks, replace(tracker or Parameters(), delay=case.delay))
    else:
        estimates = tracker(sequence.setup, ticks)  # type: ignore[assignment]
    results = Results.of(check_estimates("under test", estimates, sequence.setup, ticks), {})
    seconds = time.process_time() - began
    people = {t.index: (t.person_id, t.feet) for t in sequence.truth}
    found = score(matching_frames(people, results.tracks, evaluated_people(sequence.truth, sequence.setup.period))).to_dict()
    figures = {name: math.nan if found[name] is None else float(found[name] or 0.0) for name in FIGURES}
    return figures | {"seconds": seconds}


def score_case(source: CaseSource, number: int, candidate: Candidate) -> dict[str, Any]:
    """Figures of FIGURES and `seconds`, or `error` in one line that names the case. It raises nothing but KeyboardInterrupt."""
    name = f"case {number}"
    try:
        case = source.case(number)
        name = f"case {number} ({case.kind})"
        return dict(evaluate(case, _tracker(candidate)))
    except Exception as error:
        said = " ".join(str(error).split())
        return {"error": f"{name}: {said if isinstance(error, ValueError) else f'{type(error).__name__}: {said}'}"[:300]}


def draw_case(source: CaseSource, number: int) -> str:
    """Draw a case unless its file exists. Returns its name. Raises ValueError for a file of another version."""
    return source.case(number).name


def _tracker(candidate: Candidate) -> Any:
    if not candidate.function:
        return Parameters(targets=with_fields(Parameters().targets, candidate.values))
    function: Callable[..., Any] = load_tracker(candidate.function)
    return lambda setup, ticks: function(setup, ticks, **candidate.values)


def worst_mean(scores: list[float]) -> float:
    """Mean of the worst tenth, of one score at least."""
    return float(np.sort(scores)[: max(1, round(WORST * len(scores)))].mean())


def objective_value(objective: str, scores: list[float]) -> float:
    """The objective of scores of all cases."""
    mean = float(np.mean(scores))
    return (mean + worst_mean(scores)) / 2 if objective.endswith("-worst") else mean
