"""One trial: a case with a seed is simulated, tracked, scored and diagnosed. The result is a row of JSON values."""

from __future__ import annotations

import json
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sim.recording.record import versions
from sim.stress import ablation, bounds, error_causes, worst_moments
from sim.stress.result_rows import SCHEMA
from sim.stress.sweeps import RECORDED, Case
from sim.stress.tracker_under_test import TrackerUnderTest
from sim.stress.trial_data import TrialData, simulate_case
from tracker.metrics.clear_mot import score
from tracker.metrics.evaluation import evaluate
from tracker.metrics.landmark_map import MapScore
from tracker.person_detector.detector import PersonDetector
from tracker.person_detector.network import PersonNetwork
from tracker.sequence.results import Results
from tracker.types import Sequence

ROBOTS = ("ate_aligned_m", "rpe_m", "rpe_between_m", "nees_per_dof")
TARGETS = ("mota", "idf1", "hota", "motp_m", "false_positives", "misses", "switches", "truths")


@dataclass(frozen=True)
class Trial:
    """A case with a seed, and a tracker.

    case: its scenario has the seed. folder: of the results, for pictures. rendered: with images, otherwise by ray casting. ablation: whether an
    ablation is asked for. command: the command line that repeats the trial. pixels: whether people are found in the images, by the ONNX file `model`
    or, where that is empty, by the model of the package.
    """

    case: Case
    tracker: TrackerUnderTest
    folder: Path
    rendered: bool = True
    ablation: bool = False
    command: str = ""
    pixels: bool = False
    model: str = ""

    @property
    def key(self) -> tuple[str, int, str]:
        """The key of its row: id, seed, name of the tracker."""
        return self.case.id, self.case.scenario.seed, self.tracker.name

    @property
    def detector(self) -> str:
        """Where boxes come from: the simulated detector, a real recording, or the person detector, with the check sum of its model."""
        if not self.pixels:
            return "given" if self.case.source in ("pets", RECORDED) else "simulated"
        return f"pixels {PersonNetwork(Path(self.model) if self.model else None).checksum[:12]}"

    @property
    def can_ablate(self) -> bool:
        """Whether an ablation is asked for and possible: not with a real sequence, and with pilsim's own tracker only."""
        return self.ablation and self.case.source not in ("pets", RECORDED) and not self.tracker.function and not self.tracker.results


def empty_row(trial: Trial) -> dict[str, Any]:
    """The row of a trial without results."""
    case, tracker = trial.case, trial.tracker.with_options(trial.case.options)
    return {
        "schema": SCHEMA,
        "id": case.id,
        "sweep": case.sweep,
        "parameter": case.parameter,
        "value": case.value,
        "seed": case.scenario.seed,
        "scenario": json.loads(case.scenario.to_json()) | _beyond_scenario(case),
        "tracker": {"name": tracker.name, "options": tracker.options},
        "rendered": trial.rendered and not case.source,
        "detector": trial.detector,
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


def _beyond_scenario(case: Case) -> dict[str, Any]:
    """Faults and policy of a case, which are no part of its Scenario."""
    faults = case.faults.to_dict()
    return ({"troubles": faults} if faults else {}) | ({"policy": case.policy} if case.policy else {})


def row_of(trial: Trial) -> dict[str, Any]:
    """The row of a trial. An error of the trial is not raised but stands in the row, in one line."""
    row, began = empty_row(trial), time.perf_counter()
    try:
        row |= run(trial)
    except Exception as error:
        # A tracker of the user may raise anything, and the other trials go on.
        row["error"] = f"{type(error).__name__}: {' '.join(str(error).split())[:500]}"
    return row | {"seconds": round(time.perf_counter() - began, 2)}


def run(trial: Trial) -> dict[str, Any]:
    """Scores, bounds, causes of errors, ablation and worst moments of a trial, as in its row."""
    case = trial.case
    tracker = trial.tracker.with_options(case.options)
    data = simulate_case(case, trial.rendered, PersonDetector(Path(trial.model) if trial.model else None) if trial.pixels else None)
    with tempfile.TemporaryDirectory(prefix="pilsim-graphs-") as solved:
        graphs = Path(solved) if tracker.solves_graphs else None
        results = tracker.results_of(data.tracker_setup, data.ticks, f"{case.id}/{case.scenario.seed}", graphs)
        limits = bounds.all_bounds(data, graphs, results.landmark_history)
    scores = trial_scores(data, results)
    known = scores["ate_m"] is not None and limits.get("ate_bound_m")
    scores["efficiency"] = scores["ate_m"] / limits["ate_bound_m"] if known else None
    evidence = error_causes.gather_evidence(data, results)
    mistakes = error_causes.find_mistakes(evidence)
    shares = ablation.ablate(data, tracker) if trial.can_ablate else None
    kept = worst_moments.find_worst(mistakes)
    return {
        "scores": scores,
        "limits": limits,
        "causes": error_causes.count_causes(mistakes),
        "ladder": shares,
        "moments": worst_moments.draw_pictures(kept, evidence, data, results, trial.folder / "moments" / worst_moments.file_stem(trial.key)),
    }


def trial_scores(data: TrialData, results: Results) -> dict[str, Any]:
    """The scores of a row. Scores of robots are None where the tracker reports no poses, or no robot moves from a known start."""
    truth = data.truth
    if results.poses:
        sequence = Sequence(data.setup, data.in_memory(), truth, {})
        everything = evaluate(sequence, results)
        targets, everybody = everything["targets"], everything["everybody"]
        robots, reckoned = everything["robots"] or {}, everything["dead_reckoning"] or {}
    else:
        targets, everybody = (score(data.matching_frames(results, every)).to_dict() for every in (False, True))
        robots, reckoned = {}, {}
    out = {name: targets[name] for name in TARGETS}
    out |= {"mota_all": everybody["mota"], "ate_m": robots.get("ate_m"), "dead_reckoning_m": reckoned.get("ate_m")}
    return out | {name: robots.get(name) for name in ROBOTS} | (bounds.map_score(data, results) or MapScore()).to_dict()
