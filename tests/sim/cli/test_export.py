"""The command `pilsim export`, as a process."""

import json
from pathlib import Path

import numpy as np
import pytest

from tests.commands import pilsim
from tests.tracker import sequences
from tracker.sequence.results import Results, write_results


@pytest.mark.command
def test_an_export_reports_its_folder(tmp_path: Path) -> None:
    sequences.write(tmp_path / "s")
    done = pilsim("export", "s", "--format", "tum", "--out", "tum", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert done.stdout == "tum: 1 sequence as tum; README.md in it explains every column\n"
    # Progress is shown in terminals only.
    assert done.stderr == ""
    done = pilsim("export", "s", "--format", "jrdb", "--out", "jrdb", "--json", cwd=tmp_path)
    assert json.loads(done.stdout) == {"out": "jrdb", "format": "jrdb", "sequences": ["s"]}


@pytest.mark.command
@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("s", "--format", "pets", "--out", "out"), "error: s: has no fixed pinhole camera"),
        (("nowhere", "--format", "tum", "--out", "out"), "error: nowhere: neither a sequence"),
    ],
)
def test_errors_are_one_line(tmp_path: Path, arguments: tuple[str, ...], message: str) -> None:
    sequences.write(tmp_path / "s")
    done = pilsim("export", *arguments, cwd=tmp_path)
    assert done.returncode == 2
    assert done.stderr.startswith(message)
    assert len(done.stderr.splitlines()) == 1
    assert [p.name for p in tmp_path.iterdir()] == ["s"]


@pytest.mark.command
def test_results_become_the_file_of_an_aicity_submission(tmp_path: Path) -> None:
    write_results(tmp_path / "run", Results(2, {1: (np.array([3]), np.array([[1.0, 2.0, 0.0]]))}, {}, {}, {"source": "Warehouse_017"}))
    done = pilsim("export", "run", "--format", "aicity", "--out", "out", cwd=tmp_path)
    assert (done.returncode, done.stdout) == (0, "out: track1.txt of scene 17\n"), done.stderr
    assert (tmp_path / "out" / "track1.txt").read_text() == "17 0 3 1 1 2 0.875 0.6 0.6 1.75 0\n"
    done = pilsim("export", "run", "--format", "aicity", "--out", "other", "--scene", "4", "--json", cwd=tmp_path)
    assert json.loads(done.stdout) == {"out": "other", "format": "aicity", "scene": 4}
    done = pilsim("export", "run", "--format", "tum", "--out", "tum", "--scene", "4", cwd=tmp_path)
    assert (done.returncode, done.stderr) == (2, "error: --scene is for the results of `track` with --format aicity\n")
