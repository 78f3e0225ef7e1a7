"""Searches with the real Optuna and its SQLite file: what they find, races, kills, shared folders, clusters, and one line for what is wrong."""

from __future__ import annotations

import html
import json
import os
import re
import shlex
import signal
import sqlite3
import subprocess
import sys
import time
from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sim.cli.main import _parse
from sim.report.tuning_page import write_tuning_page
from sim.tuning.case_file import PopulationCase, case_path, write_case
from sim.tuning.kinds import scene
from sim.tuning.population import PopulationKey, case_of, kind_of
from sim.tuning.scoring import CaseSource, objective_value
from sim.tuning.search import SearchPlan, is_worse
from sim.tuning.tuned import HeldOut, TunedResult
from tests.benchmarks.nearest_neighbour import nearest_neighbour
from tests.commands import pilsim
from tracker.parameter_file import read_parameters
from tracker.types import Estimate, Setup, Tick

SEED, CASES, OTHERS = 5, 10, 2
NEAREST = "tests.benchmarks.nearest_neighbour:nearest_neighbour"
HERE = "tests.sim.tuning.test_search"
SPACE = "[gate]\nrange = [0.05, 3.0]\nlog = true\n[least_confidence]\nrange = [-2.0, 0.9]\n[lost]\nrange = [0.1, 3.0]\n"
PILSIM = [sys.executable, "-c", "from sim.cli.main import main; main()"]


def raising(setup: Setup, ticks: Iterable[Tick], gate: float = 1.0) -> Iterator[Estimate]:
    """A tracker that fails with a large gate."""
    if gate > 1.0:
        raise ZeroDivisionError("nobody\nis there")
    return nearest_neighbour(setup, ticks, gate)


def broken(setup: Setup, ticks: Iterable[Tick], gate: float = 1.0) -> Iterator[Estimate]:
    """A tracker that always gives places that are no numbers."""
    for estimate in nearest_neighbour(setup, ticks, gate):
        yield replace(estimate, position=np.full(estimate.position.shape, np.nan))


def failing_elsewhere(setup: Setup, ticks: Iterable[Tick], gate: float = 1.0) -> Iterator[Estimate]:
    """A tracker that fails in the first of the other cases, which it knows by its area."""
    if setup.area is not None and np.allclose(setup.area, np.asarray(small_case(CASES).recording.area)):
        raise ZeroDivisionError("nobody is there")
    return nearest_neighbour(setup, ticks, gate)


def small_case(number: int) -> PopulationCase:
    """A case of few frames in a room, with the number's kind on its file."""
    made = replace(scene("office", np.random.default_rng([SEED, number])), most_frames=10)
    return case_of(PopulationKey(number, SEED, kind_of(number, SEED)), made)


@pytest.fixture(scope="module")
def cases(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of small cases."""
    folder = tmp_path_factory.mktemp("cases")
    for number in range(CASES + OTHERS):
        write_case(case_path(folder, number, SEED), small_case(number))
    return folder


@pytest.fixture
def words(cases: Path, tmp_path: Path) -> list[str]:
    """The command without --out and --trials."""
    (tmp_path / "space.toml").write_text(SPACE)
    numbers = ["--population", str(CASES), "--held-out", str(OTHERS), "--seed", str(SEED)]
    return ["tune", "--tracker", NEAREST, "--space", str(tmp_path / "space.toml"), "--cases", str(cases), *numbers]


def trials_of(folder: Path) -> list[tuple[str, float | None, dict[str, object]]]:
    """State, value and parameters of all trials."""
    import optuna

    found = optuna.load_study(study_name="tune", storage=f"sqlite:///{folder / 'study.db'}").get_trials()
    return [(one.state.name, one.value, one.params) for one in found]


def scores_noted(folder: Path) -> int:
    """Number of scores in the storage, 0 where there is none yet."""
    try:
        with sqlite3.connect(f"file:{folder / 'study.db'}?mode=ro", uri=True) as storage:
            return int(storage.execute("SELECT COUNT(*) FROM trial_intermediate_values").fetchone()[0])
    except sqlite3.OperationalError:
        return 0


def test_the_worst_tenth_counts_half_where_it_is_asked_for() -> None:
    scores = [0.0, *[0.9] * 19]
    assert objective_value("hota", scores) == pytest.approx(0.855)
    assert objective_value("hota-worst", scores) == pytest.approx((0.855 + 0.45) / 2)


def test_a_trial_with_a_better_worst_tenth_is_not_ended_for_its_other_scores() -> None:
    theirs = [0.1, *np.linspace(0.8, 0.9, 19).tolist()]
    mine = [0.5, *(score - 0.01 for score in theirs[1:])]
    assert not is_worse("hota", mine, theirs)
    lower = [0.1, *mine[1:]]
    assert is_worse("hota", lower, theirs)
    shifted = [0.25, *(score - 0.01 for score in theirs[1:])]
    assert is_worse("hota", shifted, theirs)
    assert not is_worse("hota-worst", shifted, theirs)
    assert not is_worse("hota", theirs, theirs)


def test_gains_are_paired_and_by_kind() -> None:
    default = {k: {"hota": 0.1 * k} for k in range(6)}
    best = {k: {"hota": 0.1 * k + (0.05 if k < 3 else -0.05) + 0.001 * k} for k in range(6)} | {6: {"hota": float("nan")}}
    tried = HeldOut(default | {6: {"hota": 0.5}}, best, {k: "lab" if k < 3 else "hall" for k in range(7)}, "hota")
    gains = tried.gains()
    assert list(gains) == ["all", "hall", "lab"]
    assert (gains["all"].verdict, gains["hall"].verdict, gains["lab"].verdict) == ("no difference seen", "lower", "higher")
    assert tried.worst(2) == [0, 1]


def test_the_page_says_where_unlisted_failures_are(tmp_path: Path) -> None:
    plan = SearchPlan(tmp_path, "", (), {}, CaseSource(tmp_path / "cases", SEED), CASES)
    found = TunedResult({}, 0, 0.5, 0.5, 41, 0, 40, ("boom",) * 40, ((0, 0.5),), (), {}, None)
    assert "<p>10 more are in study.db.</p>" in write_tuning_page(plan, found, "pilsim tune").read_text()


@pytest.mark.command
def test_a_search_is_no_worse_than_the_default_and_its_files_are_of_use(words: list[str], tmp_path: Path) -> None:
    out = tmp_path / "out"
    first = pilsim(*words, "--trials", 12, "--out", out)
    assert first.returncode == 0, first.stderr
    found = json.loads((out / "result.json").read_text())
    assert found["value"] >= found["default_value"]
    assert found["early"] > 0
    assert read_parameters(out / "best.toml") == found["best"]
    page = (out / "index.html").read_text()
    assert page.count('<figure id="plot-') >= 5
    assert page.count("data:image/jpeg") == OTHERS
    command = shlex.split(html.unescape(page.split("<code>")[1].split("</code>")[0]))
    assert _parse(command[1:]) == _parse([*words, "--trials", "12", "--out", str(out)])
    again = pilsim(*words, "--trials", 12, "--out", out, "--json")
    assert json.loads(again.stdout) == found
    assert len(trials_of(out)) == 12
    other = pilsim(*words, "--trials", 12, "--out", out, "--objective", "mota")
    assert (other.returncode, other.stderr.count("\n")) == (2, 1)
    assert "objective hota there, mota asked for" in other.stderr


@pytest.mark.command
@pytest.mark.parametrize(
    ("changes", "said"),
    [
        (["--tracker", f"{HERE}:broken"], "fails with its default parameters: case 0 .*position holds NaN"),
        (["--tracker", f"{HERE}:nothing"], "has no function nothing"),
        (["--time", "0"], "--time is 0"),
        (["--people", "3"], "need SOURCE"),
        (["nowhere"], "nowhere: no such"),
        (["--population", "1"], "--population is 1"),
    ],
)
def test_what_is_wrong_is_one_line(words: list[str], tmp_path: Path, changes: list[str], said: str) -> None:
    (tmp_path / "gate.toml").write_text("[gate]\nrange = [0.5, 3.0]")
    done = pilsim(*words, "--space", tmp_path / "gate.toml", *changes, "--trials", 3, "--out", tmp_path / "out")
    assert done.returncode == 2
    errors = [line for line in done.stderr.splitlines() if line.startswith("error: ")]
    assert len(errors) == 1
    assert re.search(said, errors[0])


@pytest.mark.command
def test_a_trial_that_fails_is_counted_and_names_its_case(words: list[str], tmp_path: Path) -> None:
    (tmp_path / "gate.toml").write_text("[gate]\nrange = [0.5, 3.0]")
    done = pilsim(*words, "--tracker", f"{HERE}:raising", "--space", tmp_path / "gate.toml", "--trials", 6, "--out", tmp_path / "out")
    assert done.returncode == 0, done.stderr
    failed = [line for line in done.stdout.splitlines() if line.startswith("failed: trial")]
    assert failed
    assert all("case 0 (" in line and "ZeroDivisionError: nobody is there" in line for line in failed)


@pytest.mark.command
def test_a_failure_on_another_case_is_named_and_the_result_is_written(words: list[str], tmp_path: Path) -> None:
    (tmp_path / "gate.toml").write_text("[gate]\nrange = [0.5, 3.0]")
    words = [*words, "--tracker", f"{HERE}:failing_elsewhere", "--space", str(tmp_path / "gate.toml")]
    done = pilsim(*words, "--trials", 1, "--out", tmp_path / "out")
    assert done.returncode == 0, done.stderr
    assert f"failed: default parameters: case {CASES} (" in done.stdout
    assert (tmp_path / "out" / "best.toml").is_file()
    assert (tmp_path / "out" / "index.html").is_file()


@pytest.mark.soak
def test_a_search_that_is_killed_five_times_gives_the_same_trials(words: list[str], tmp_path: Path) -> None:
    assert pilsim(*words, "--trials", 14, "--out", tmp_path / "whole").returncode == 0
    rng, until = np.random.default_rng(1), 0
    for _ in range(5):
        run = subprocess.Popen([*PILSIM, *words, "--trials", "14", "--out", str(tmp_path / "killed")], stderr=subprocess.DEVNULL)
        until += int(rng.integers(1, 10))
        while scores_noted(tmp_path / "killed") < until:
            assert run.poll() is None
            time.sleep(0.01)
        time.sleep(float(rng.uniform(0.0, 0.2)))
        os.kill(run.pid, signal.SIGKILL)
        run.wait()
    assert pilsim(*words, "--trials", 14, "--out", tmp_path / "killed").returncode == 0
    assert trials_of(tmp_path / "killed") == trials_of(tmp_path / "whole")


@pytest.mark.soak
def test_two_processes_and_a_cluster_do_each_trial_once(words: list[str], tmp_path: Path, dask_cluster: Any) -> None:
    both = [subprocess.Popen([*PILSIM, *words, "--trials", "8", "--out", str(tmp_path / "two")]) for _ in range(2)]
    assert all(one.wait(timeout=900) in (0, 2) for one in both)
    assert any(one.returncode == 0 for one in both)
    done = pilsim(*words, "--trials", 8, "--cluster", dask_cluster.scheduler_address, "--out", tmp_path / "cluster")
    assert done.returncode == 0, done.stderr
    for name in ("two", "cluster"):
        trials = trials_of(tmp_path / name)
        assert [state for state, _, _ in trials] == ["COMPLETE"] * 8
        best = json.loads((tmp_path / name / "result.json").read_text())
        assert best["value"] >= best["default_value"]
