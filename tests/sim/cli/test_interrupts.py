"""Ctrl-C at any time: one line, exit code 130, what is whole remains, no process is left.

A terminal sends the signal to all processes of the group, and so do these tests.
"""

import contextlib
import os
import signal
import subprocess
import sys
import time
import uuid
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]
BUSY = ("--people", "3", "--robots", "2", "--width", "256")


@pytest.fixture(autouse=True)
def signal_reaches_children() -> Iterator[None]:
    """A shell starts background jobs with this signal ignored, and children inherit that."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


class Interrupted:
    """A command that gets the signal once `ready()` is true: its exit code, standard error, and the processes that it left."""

    def __init__(self, ready: Callable[[], bool], *words: str) -> None:
        mark = f"PILSIM_TEST={uuid.uuid4()}"
        command = ["env", mark, sys.executable, "-m", "pilsim", *words]
        process = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True)
        try:
            until = time.monotonic() + 300
            while not ready():
                assert process.poll() is None, f"ended before the signal: {process.communicate()}"
                assert time.monotonic() < until, "is not ready for the signal"
                time.sleep(0.02)
            os.killpg(process.pid, signal.SIGINT)
            self.output, self.error = process.communicate(timeout=60)
            self.code = process.returncode
            self.left = marked(mark)
        finally:
            for other in marked(mark):
                os.kill(other, signal.SIGKILL)


def marked(mark: str) -> list[int]:
    """Living processes whose environment holds a mark (Linux)."""
    out = []
    for path in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):
            if mark.encode() in (path / "environ").read_bytes():
                out.append(int(path.name))
    return out


def after(seconds: float) -> Callable[[], bool]:
    until = time.monotonic() + seconds
    return lambda: time.monotonic() > until


def exists(folder: Path, pattern: str, number: int = 1) -> Callable[[], bool]:
    return lambda: len(list(folder.glob(pattern))) >= number


def check(done: Interrupted) -> None:
    assert done.code == 130, done.error
    lines = [line for line in done.error.splitlines() if " [" not in line]
    assert len(lines) == 1, done.error
    assert lines[0].startswith("interrupted")
    assert not done.left


@pytest.mark.command
def test_clique(tmp_path: Path) -> None:
    (tmp_path / "a.clq").write_text("p edge 3 2\ne 1 2\ne 2 3\n")
    check(Interrupted(after(4.0), "clique", str(tmp_path / "a.clq"), "--seconds", "100"))


@pytest.mark.soak
def test_generate_by_two_workers(tmp_path: Path) -> None:
    words = ("generate", "pilsun", "--frames", "40", "--count", "2", "--workers", "2", *BUSY, "--fixed-cameras", "0", "--out", str(tmp_path / "d"))
    check(Interrupted(exists(tmp_path, "d/.*/images/robot_0_camera/*", 8), *words))


AT_IMPORT = """
import os, signal, sys
class Hook:
    def find_spec(self, name, path=None, target=None):
        if name == {name!r} and not Hook.done:
            Hook.done = True
            {act}
    done = False
sys.meta_path.insert(0, Hook())
sys.argv = ["pilsim", "clique", "--help"]
import pilsim
pilsim.main()
"""
SEND = "os.kill(os.getpid(), signal.SIGINT)"
IN_DESTRUCTOR = "type('Last', (), {'__del__': lambda self: os.kill(os.getpid(), signal.SIGINT)})()"
SWALLOWED = f"""
            try:
                {SEND}
                for _ in range(100): pass
            except BaseException:
                pass"""
AS_IMPORT_ERROR = f"""
            try:
                {SEND}
                for _ in range(100): pass
            except BaseException:
                raise ImportError('bad install')"""


@pytest.mark.command
@pytest.mark.parametrize(
    ("name", "act"),
    [("sim.cli.main", SEND), ("numpy.linalg", IN_DESTRUCTOR), ("tyro", SWALLOWED), ("numpy.linalg", AS_IMPORT_ERROR)],
    ids=["plain", "destructor", "swallowed", "import error"],
)
def test_during_imports(name: str, act: str) -> None:
    done = subprocess.run([sys.executable, "-c", AT_IMPORT.format(name=name, act=act)], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 130, done.stderr
    assert done.stderr.count("\n") == 1, done.stderr
    assert done.stderr.startswith("interrupted")
