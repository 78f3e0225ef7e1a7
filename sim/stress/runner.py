"""Trials, which run on all cores or on a cluster and write results.jsonl. The same command resumes an interrupted run.

One trial is a case with a seed: it is simulated, tracked, scored and diagnosed. The result is a row of JSON values.
"""

from __future__ import annotations

import json
import os
import tempfile
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Executor
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sim.parallel.pool import Pool, processes
from sim.recording.record import versions
from sim.stress import ablation, bounds, error_causes, worst_moments
from sim.stress.bounds import MEASURES
from sim.stress.result_rows import RESULTS, SCHEMA, read_result_rows
from sim.stress.sweeps import RECORDED, Case
from sim.stress.tracker_under_test import TrackerUnderTest
from sim.stress.trial_data import TrialData, simulate_case
from tracker.io.atomic import write_text
from tracker.io.file_lock import folder_lock
from tracker.io.json_files import json_text
from tracker.io.resume import check_same, holds_run
from tracker.metrics.clear_mot import score
from tracker.metrics.evaluation import evaluate
from tracker.person_detector.detector import PersonDetector
from tracker.person_detector.network import PersonNetwork
from tracker.sequence.results import Results
from tracker.types import Sequence

ROBOTS = ("ate_aligned_m", "rpe_m", "rpe_between_m", "nees_per_dof")
TARGETS = ("mota", "idf1", "hota", "motp_m", "false_positives", "misses", "switches", "truths")
RUN = "run.json"
LIMIT = 1800.0
"""Time limit of a trial, s, where none is given."""
Key = tuple[str, int, str]


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
    return out | {name: robots.get(name) for name in ROBOTS} | (bounds.map_score(data, results) or dict.fromkeys(MEASURES))


def run_trials(
    trials: Iterable[Trial], folder: Path, command: str, pool: Pool | None = None, limit: float = LIMIT, progress: Callable[..., Any] | None = None
) -> list[dict[str, Any]]:
    """Run trials into a folder, and return all of its rows. Trials with a row without an error are not run again.

    command: the command line, for run.json. pool: where trials run, None for one after another. limit: time limit of a trial, s.
    progress: wraps the rows as they come, like tqdm. Raises ValueError where the folder is a file, holds
    something else or results of another version, and where another process writes into it.
    """
    with _locked(folder):
        rows = {key_of(row): row for row in _read_rows(folder)}
        wanted = list(trials)
        done = {key for key, row in rows.items() if row["error"] is None}
        done -= {trial.key for trial in wanted if trial.key in done and not _is_complete(folder, rows[trial.key], trial)}
        todo = [trial for trial in wanted if trial.key not in done]
        write_text(folder / RUN, json_text({"schema": SCHEMA, "command": command, "versions": versions()}, indent=1) + "\n")
        # Failed trials are tried again. Kept rows are rewritten, which removes a line that was cut off.
        _write_rows(folder, [row for key, row in rows.items() if key in done])
        # Each thread waits for a process of its own, which does the work. Rows come in the order in which trials end.
        made = (pool or Pool()).as_completed(_row, ((trial, limit) for trial in todo), threads=True) if todo else iter(())
        shown = progress(made, total=len(todo)) if progress else made
        with (folder / RESULTS).open("a", encoding="utf-8") as file:
            for row in shown:
                rows[key_of(row)] = row
                file.write(json_text(row) + "\n")
                file.flush()
                os.fsync(file.fileno())
        ordered = [rows[key] for key in sorted(rows, key=_order)]
        _write_rows(folder, ordered)
    return ordered


def key_of(row: dict[str, Any]) -> Key:
    """The key of a row: id, seed, name of the tracker."""
    return row["id"], row["seed"], row["tracker"]["name"]


def _is_complete(folder: Path, row: dict[str, Any], trial: Trial) -> bool:
    """Whether a row holds all that a trial would give, its ablation too. Raises ValueError where the row is of another run."""
    asked = empty_row(trial)
    wanted = {name: asked[name] for name in ("scenario", "tracker", "rendered", "value", "detector")}
    # Rows of version 0.3.0 do not name the detector, which was never the one on pixels.
    older = {"detector": "simulated" if trial.pixels else asked["detector"]}
    check_same(folder, older | row, wanted, f"{row['id']} seed {row['seed']} of another run")
    return row["ladder"] is not None or not trial.can_ablate


def _order(key: Key) -> tuple[str, int, int, str]:
    name, _, number = key[0].partition("/")
    return name, int(number) if number.isdecimal() else 0, key[1], key[2]


def _row(trial: Trial, limit: float) -> dict[str, Any]:
    """The row of a trial, from the process of this thread."""
    own = threading.get_ident(), limit
    if own not in _workers:
        _workers[own] = Worker(limit)
    return _workers[own].row(trial)


class Worker:
    """A process that runs trials one after the other, so that a tracker that hangs or crashes loses its own row only.

    It starts with the first trial, and is replaced where a trial takes more than `limit` s.
    """

    def __init__(self, limit: float) -> None:
        self.limit = limit
        self._stack = ExitStack()
        self._executor: Executor | None = None

    def row(self, trial: Trial) -> dict[str, Any]:
        """The row of a trial. Where the process crashed or took too long, the row has that error."""
        began = time.perf_counter()
        if self._executor is None:
            self._executor = self._stack.enter_context(processes(1, __name__))
        future = self._executor.submit(plain_row, trial)
        try:
            if (error := future.exception(self.limit)) is None:
                return dict(future.result())
            fault = f"RuntimeError: the process ended in the middle of it ({type(error).__name__})"
        except TimeoutError:
            fault = f"TimeoutError: took more than {self.limit:g} s and was ended"
        self.close()
        return empty_row(trial) | {"error": fault, "seconds": round(time.perf_counter() - began, 2)}

    def close(self) -> None:
        """Kill the process."""
        self._executor = None
        self._stack.close()


def plain_row(trial: Trial) -> dict[str, Any]:
    """The row of a trial as JSON has it: numbers that are not finite are None."""
    return dict(json.loads(json_text(row_of(trial))))


_workers: dict[tuple[int, float], Worker] = {}
"""The process of each thread and time limit."""


@contextmanager
def _locked(folder: Path) -> Iterator[None]:
    """Lock a folder against other processes that write rows, and end all processes of trials at the end."""
    with folder_lock(folder):
        try:
            yield
        finally:
            for worker in _workers.values():
                worker.close()
            _workers.clear()


def _read_rows(folder: Path) -> list[dict[str, Any]]:
    """The rows of a folder. A last line that is cut off is left out. Raises ValueError as read_result_rows."""
    if not holds_run(folder, RESULTS, (RUN, "moments")):
        return []
    return [{"error": None, "ladder": None} | row.values for row in read_result_rows(folder / RESULTS)[0]]


def _write_rows(folder: Path, rows: list[dict[str, Any]]) -> None:
    write_text(folder / RESULTS, "".join(json_text(row) + "\n" for row in rows))
