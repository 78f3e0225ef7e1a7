"""File locks: one process holds a lock at a time, and a process that ended holds none."""

import subprocess
import sys
import time
from pathlib import Path

import pytest
from filelock import FileLock

from tracker.io.file_lock import Locked, file_lock, holder_file

HOLD = """
import sys, time
from pathlib import Path
from tracker.io.file_lock import file_lock
with file_lock(Path(sys.argv[1]), wait=True):
    print("held", flush=True)
    time.sleep({})
"""
COUNT = """
import sys
from pathlib import Path
from tracker.io.file_lock import file_lock
count = Path(sys.argv[2])
for _ in range(100):
    with file_lock(Path(sys.argv[1]), wait=True):
        count.write_text(str(int(count.read_text()) + 1))
"""
ROOT = Path(__file__).parents[3]


def holder(path: Path, seconds: float) -> subprocess.Popen[str]:
    """A process that holds the lock for so long."""
    process = subprocess.Popen([sys.executable, "-c", HOLD.format(seconds), path], cwd=ROOT, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert process.stdout.readline() == "held\n"
    return process


def test_a_second_process_is_refused_until_the_first_is_killed(tmp_path: Path) -> None:
    path = tmp_path / ".lock"
    with holder(path, 60) as first:
        with pytest.raises(Locked, match=rf"is being written by another pilsim \(process {first.pid} on .*, since 20"), file_lock(path):
            pass
        first.kill()
        first.wait()
    assert path.exists()
    with file_lock(path):
        assert path.read_bytes() == b""
    assert list(tmp_path.iterdir()) == []


def test_a_process_that_waits_gets_the_lock_when_it_is_free(tmp_path: Path) -> None:
    """This holds where the lock file is removed and made again during the wait."""
    path, begun = tmp_path / ".lock", time.monotonic()
    with holder(path, 0.7), file_lock(path, wait=True):
        assert time.monotonic() - begun > 0.5
        with pytest.raises(Locked), file_lock(path):
            pass
    assert list(tmp_path.iterdir()) == []


def test_one_holder_at_a_time_though_the_file_is_removed_at_each_release(tmp_path: Path) -> None:
    """Four processes increase one number. An increase would be lost where two of them hold the lock at once."""
    path, count = tmp_path / ".lock", tmp_path / "count"
    count.write_text("0")
    processes = [subprocess.Popen([sys.executable, "-c", COUNT, path, count], cwd=ROOT) for _ in range(4)]
    assert [process.wait(120) for process in processes] == [0] * 4
    assert count.read_text() == "400"
    assert list(tmp_path.iterdir()) == [count]


def test_an_error_releases_the_lock(tmp_path: Path) -> None:
    with pytest.raises(RuntimeError), file_lock(tmp_path / ".lock"):
        raise RuntimeError("an error inside the lock")
    assert list(tmp_path.iterdir()) == []


def test_a_holder_that_has_not_written_its_id_yet_is_unknown(tmp_path: Path) -> None:
    path = tmp_path / ".lock"
    with FileLock(path), pytest.raises(Locked, match=r"is being written by another pilsim \(process unknown\)") as error, file_lock(path):
        pass
    assert "\n" not in str(error.value)
    assert not holder_file(path).exists()


def test_a_missing_folder_is_not_made(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError), file_lock(tmp_path / "none" / ".lock"):
        pass
    assert list(tmp_path.iterdir()) == []
