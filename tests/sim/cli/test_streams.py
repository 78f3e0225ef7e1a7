"""Standard streams that are closed, full, or lack characters end no work."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

GRAPH = "p edge 3 2\ne 1 2\ne 2 3\n"


def shell(command: str, folder: Path, **environment: str) -> subprocess.CompletedProcess[bytes]:
    """A command line of the shell in `folder`; PILSIM stands for the program."""
    text = command.replace("PILSIM", f"{sys.executable} -m pilsim")
    root = str(Path(__file__).parents[3])
    return subprocess.run(
        ["bash", "-c", text], cwd=folder, env=dict(os.environ, PYTHONPATH=root, **environment), capture_output=True, check=False, timeout=120
    )


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "a.clq").write_text(GRAPH)
    return tmp_path


@pytest.mark.parametrize("closed", [">&-", "2>&-", ">&- 2>&-", "<&- >&- 2>&-"])
def test_closed_streams(folder: Path, closed: str) -> None:
    done = shell(f"PILSIM clique a.clq --seconds 0.1 --json {closed}", folder)
    assert done.returncode == 0
    assert b"Traceback" not in done.stderr


def test_a_full_standard_output_is_one_line(folder: Path) -> None:
    done = shell("PILSIM clique a.clq --seconds 0.1 --json > /dev/full", folder)
    assert (done.returncode, done.stderr) == (2, b"error: standard output: No space left on device\n")


def test_a_full_standard_error_does_not_end_the_work(folder: Path) -> None:
    done = shell("PILSIM worlds pilsun --export runs/lab.ply 2> /dev/full", folder)
    assert done.returncode == 0
    assert (folder / "runs" / "lab.ply").stat().st_size > 1000


def test_characters_that_a_stream_lacks_are_replaced(folder: Path) -> None:
    for words, code in (("track --help", 0), ("stress --help", 0), ("track x --hypothésis y --out z", 2)):
        done = shell(f"PILSIM {words}", folder, PYTHONIOENCODING="iso-8859-1")
        assert done.returncode == code, done.stderr
        assert b"codec" not in done.stderr


def test_a_reader_that_ends_early_is_no_error(folder: Path) -> None:
    done = shell("set -o pipefail; PILSIM track --help | head -1", folder)
    assert b"Traceback" not in done.stderr
    assert b"Exception" not in done.stderr
