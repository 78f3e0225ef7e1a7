"""One trial: a case with a seed is simulated, tracked, scored and explained; what comes out is a row, JSON values all through."""

from __future__ import annotations

import json
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sim.recording.record import versions
from sim.stress import ablation, bounds, error_causes, worst_moments
from sim.stress.footage import TrialData, simulate_case
from sim.stress.map_truth import map_score
from sim.stress.sweeps import Case
from sim.stress.tracker_under_test import TrackerUnderTest
from tracker.metrics.clear_mot import score
from tracker.metrics.evaluation import evaluate, who_counts
from tracker.metrics.landmark_map import MapScore
from tracker.metrics.matching import MatchingFrame
from tracker.sequence.results import Results
from tracker.types import Sequence

SCHEMA = 1
ROBOTS = ("ate_aligned_m", "rpe_m", "rpe_between_m", "nees_per_dof")
TARGETS = ("mota", "idf1", "hota", "motp_m", "false_positives", "misses", "switches", "truths")


@dataclass(frozen=True)
class Trial:
    """case: its scenario has the seed; folder: where pictures go; rendered: panoramas and SIFT, else rays; climbed: with the ladder; command: the
    line to give to get it again.
    """

    case: Case
    contender: TrackerUnderTest
    folder: Path
    rendered: bool = True
    climbed: bool = False
    command: str = ""

    @property
    def key(self) -> tuple[str, int, str]:
        """What the row is of: id, seed, tracker."""
        return self.case.id, self.case.scenario.seed, self.contender.name

    @property
    def climbs(self) -> bool:
        """Whether a ladder is asked for and can be had: nothing of a real sequence or of somebody else's tracker can be replaced."""
        return self.climbed and self.case.source != "pets" and not self.contender.function and not self.contender.results

    def to_json(self) -> str:
        """One line, for another process."""
        contender = {"function": self.contender.function, "options": self.contender.options, "results": self.contender.results}
        plain = {"folder": str(self.folder), "rendered": self.rendered, "climbed": self.climbed, "command": self.command}
        return json.dumps(plain | {"case": self.case.to_json(), "contender": contender})

    @staticmethod
    def from_json(text: str) -> Trial:
        """What to_json wrote."""
        content = json.loads(text)
        case, contender = Case.from_json(content.pop("case")), TrackerUnderTest(**content.pop("contender"))
        return Trial(case, contender, Path(content.pop("folder")), **content)


def blank(trial: Trial) -> dict[str, Any]:
    """The row of a trial of which nothing is known yet."""
    case, contender = trial.case, trial.contender.with_options(trial.case.options)
    return {
        "schema": SCHEMA,
        "id": case.id,
        "sweep": case.sweep,
        "parameter": case.parameter,
        "value": case.value,
        "seed": case.scenario.seed,
        "scenario": json.loads(case.scenario.to_json()) | _besides(case),
        "tracker": {"name": contender.name, "options": contender.options},
        "rendered": trial.rendered and not case.source,
        "seconds": None,
        "error": None,
        "scores": None,
        "limits": None,
        "causes": None,
        "ladder": None,
        "moments": [],
        "versions": versions(),
        "command": trial.command,
    }


def _besides(case: Case) -> dict[str, Any]:
    """What makes a run beside its Scenario."""
    troubles = case.troubles.to_dict()
    return ({"troubles": troubles} if troubles else {}) | ({"policy": case.policy} if case.policy else {})


def attempted(trial: Trial) -> dict[str, Any]:
    """The row of a trial; what went wrong is in `error`, in one line, and nothing is raised but the end of the process."""
    row, began = blank(trial), time.perf_counter()
    try:
        row |= run(trial)
    except Exception as error:
        # A tracker of somebody else's may raise anything, and the other rows shall come all the same.
        row["error"] = f"{type(error).__name__}: {' '.join(str(error).split())[:500]}"
    return row | {"seconds": round(time.perf_counter() - began, 2)}


def run(trial: Trial) -> dict[str, Any]:
    """Scores, limits, causes, ladder and moments of a trial, as they stand in its row."""
    case = trial.case
    contender = trial.contender.with_options(case.options)
    footage = simulate_case(case, trial.rendered)
    with tempfile.TemporaryDirectory(prefix="pilsim-graphs-") as solved:
        graphs = Path(solved) if contender.solves_graphs else None
        results = contender.results_of(footage.told, footage.ticks, (case.id, case.scenario.seed), graphs)
        reachable = bounds.limits(footage, graphs, results.survey)
    scores = scored(footage, results)
    known = scores["ate_m"] is not None and reachable.get("ate_bound_m")
    scores["efficiency"] = scores["ate_m"] / reachable["ate_bound_m"] if known else None
    evidence = error_causes.gather(footage, results)
    mistakes = error_causes.mistakes(evidence)
    climbed = ablation.ablate(footage, contender) if trial.climbs else None
    kept = worst_moments.worst(mistakes)
    return {
        "scores": scores,
        "limits": reachable,
        "causes": error_causes.counted(mistakes),
        "ladder": climbed,
        "moments": worst_moments.pictured(kept, evidence, (footage, results), trial.folder / "moments", worst_moments.stem(trial.key)),
    }


def scored(footage: TrialData, results: Results) -> dict[str, Any]:
    """The scores of a row; of robots only where their places were told and are not known beforehand."""
    truth = footage.truth
    if results.poses:
        sequence = Sequence(footage.setup, footage.in_memory(), truth, {})
        everything = evaluate(sequence, results)
        targets, everybody = everything["targets"], everything["everybody"]
        robots, reckoned = everything["robots"] or {}, everything["dead_reckoning"] or {}
    else:
        targets, everybody, robots, reckoned = _people(footage, results, True), _people(footage, results, False), {}, {}
    out = {name: targets[name] for name in TARGETS}
    out |= {"mota_all": everybody["mota"], "ate_m": robots.get("ate_m"), "dead_reckoning_m": reckoned.get("ate_m")}
    return out | {name: robots.get(name) for name in ROBOTS} | (map_score(footage, results) or MapScore()).to_dict()


def _people(footage: TrialData, results: Results, by_count: bool) -> dict[str, Any]:
    nobody = (np.zeros(0, dtype=np.int64), np.zeros((0, 3)))
    counts = who_counts(footage.truth, footage.setup.period)
    frames = [
        MatchingFrame(t.person_id, t.feet, *results.tracks.get(t.index, nobody), counts=counts[k] if by_count else None)
        for k, t in enumerate(footage.truth)
    ]
    return score(frames).to_dict()
