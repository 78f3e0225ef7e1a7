"""Tracking into a folder: the same run is read, another one is refused."""

from __future__ import annotations

import importlib.metadata
import json
from dataclasses import replace
from pathlib import Path

import pytest

from tests.tracker import sequences
from tracker.pipeline import Parameters
from tracker.run import tracked
from tracker.sequence.reader import read_sequence
from tracker.sequence.results import read_results
from tracker.types import Sequence

RUN = {"source": "s", "views": []}


@pytest.fixture
def sequence(tmp_path: Path) -> Sequence:
    sequences.write(tmp_path / "s")
    return read_sequence(tmp_path / "s")


def test_the_same_run_is_read_for_any_order_of_keys(sequence: Sequence, tmp_path: Path) -> None:
    file = tmp_path / "r" / "run.json"
    tracked(sequence, tmp_path / "r", RUN)
    run = json.loads(file.read_text())
    assert run["pilsim"] == importlib.metadata.version("pilsim")
    assert run["parameters"]["targets"]["n_conf"] == Parameters().targets.n_conf
    stamp = (tmp_path / "r" / "tracks.txt").stat().st_mtime_ns
    file.write_text(json.dumps(dict(reversed(run.items())) | {"parameters": dict(reversed(run["parameters"].items()))}))
    tracked(sequence, tmp_path / "r", dict(reversed(RUN.items())), Parameters())
    assert (tmp_path / "r" / "tracks.txt").stat().st_mtime_ns == stamp


def test_another_run_is_refused_with_the_difference(sequence: Sequence, tmp_path: Path) -> None:
    tracked(sequence, tmp_path / "r", RUN)
    with pytest.raises(ValueError, match=r"r: holds another run \(parameters\.delay 0 there, 2 asked for\); choose another --out or remove it"):
        tracked(sequence, tmp_path / "r", RUN, Parameters(delay=2))
    unlimited = Parameters(slam=replace(Parameters().slam, robust=float("inf")))
    with pytest.raises(ValueError, match=r"parameters\.slam\.robust 2\.0 there, inf asked for"):
        tracked(sequence, tmp_path / "r", RUN, unlimited)
    tracked(sequence, tmp_path / "q", RUN, unlimited)
    assert read_results(tmp_path / "q").run["parameters"]["slam"]["robust"] == "inf"
