"""A claim is held by one process at a time, and a dead process holds nothing."""

import subprocess
import sys
import time
from pathlib import Path

import pytest

from sim.claim import Claimed, claim

HOLD = """
import sys, time
from pathlib import Path
from sim.claim import claim
with claim(Path(sys.argv[1]), wait=True):
    print("held", flush=True)
    time.sleep({})
"""
ROOT = Path(__file__).parent.parent.parent


def holder(path: Path, seconds: float) -> subprocess.Popen[str]:
    """A process that has the claim for so long."""
    process = subprocess.Popen([sys.executable, "-c", HOLD.format(seconds), path], cwd=ROOT, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert process.stdout.readline() == "held\n"
    return process


def test_a_second_one_is_refused_until_the_first_is_killed(tmp_path: Path) -> None:
    path = tmp_path / ".lock"
    with holder(path, 60) as first:
        with pytest.raises(Claimed, match=rf"another run \(process {first.pid}\) writes into it"), claim(path):
            pass
        first.kill()
        first.wait()
    assert path.exists()
    with claim(path):
        assert path.read_text()
    assert not path.exists()


def test_who_waits_gets_it_when_it_is_free(tmp_path: Path) -> None:
    """Also though the file that it waits for is removed and another one made under its name."""
    path, begun = tmp_path / ".lock", time.monotonic()
    with holder(path, 0.7), claim(path, wait=True):
        assert time.monotonic() - begun > 0.5
        with pytest.raises(Claimed), claim(path):
            pass
    assert not path.exists()


def test_an_error_frees_it(tmp_path: Path) -> None:
    with pytest.raises(RuntimeError), claim(tmp_path / ".lock"):
        raise RuntimeError("the light went out")
    assert list(tmp_path.iterdir()) == []
