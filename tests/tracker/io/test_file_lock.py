"""File locks: one process holds a lock at a time, and a process that ended holds none."""

import subprocess
import sys
import time
from pathlib import Path

import pytest
from filelock import FileLock

from tracker.io.atomic import LOCK
from tracker.io.file_lock import Locked, file_lock, folder_lock, holder_file

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


@pytest.mark.command
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


@pytest.mark.command
def test_a_process_that_waits_gets_the_lock_when_it_is_free(tmp_path: Path) -> None:
    """This holds where the lock file is removed and made again during the wait."""
    path, begun = tmp_path / ".lock", time.monotonic()
    with holder(path, 0.7), file_lock(path, wait=True):
        assert time.monotonic() - begun > 0.5
        with pytest.raises(Locked), file_lock(path):
            pass
    assert list(tmp_path.iterdir()) == []


@pytest.mark.command
def test_one_holder_at_a_time_though_the_file_is_removed_at_each_release(tmp_path: Path) -> None:
    """Four processes increase one number. An increase would be lost where two of them hold the lock at once."""
    path, count = tmp_path / ".lock", tmp_path / "count"
    count.write_text("0")
    processes = [subprocess.Popen([sys.executable, "-c", COUNT, path, count], cwd=ROOT) for _ in range(4)]
    assert [process.wait(120) for process in processes] == [0] * 4
    assert count.read_text() == "400"
    assert list(tmp_path.iterdir()) == [count]


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


def test_the_lock_of_a_folder_is_shared_by_its_thread_and_leaves_nothing(tmp_path: Path) -> None:
    out = tmp_path / "new" / "out"
    with folder_lock(out), folder_lock(out):
        assert sorted(path.name for path in out.iterdir()) == [".lock", ".lock.pid"]
    assert list(tmp_path.iterdir()) == []
    with folder_lock(out):
        (out / "result").touch()
    assert [path.name for path in out.iterdir()] == ["result"]


@pytest.mark.command
def test_a_link_and_its_folder_have_one_lock(tmp_path: Path) -> None:
    (tmp_path / "real").mkdir()
    (tmp_path / "link").symlink_to("real")
    with holder(tmp_path / "real" / LOCK, 60) as other:
        with pytest.raises(Locked, match=rf"link: is being written by another pilsim \(process {other.pid} on "), folder_lock(tmp_path / "link"):
            pass
        other.kill()
    with folder_lock(tmp_path / "link"):
        pass
    assert list((tmp_path / "real").iterdir()) == []


def test_a_folder_that_is_renamed_meanwhile_is_named(tmp_path: Path) -> None:
    def work() -> None:
        with folder_lock(tmp_path / "out"):
            (tmp_path / "out").rename(tmp_path / "moved")
            (tmp_path / "out" / "result").touch()

    with pytest.raises(FileNotFoundError, match="was removed or renamed while pilsim wrote into it"):
        work()
    assert [path.name for path in tmp_path.iterdir()] == ["moved"]
    with folder_lock(tmp_path / "moved"):
        pass


def test_another_host_that_did_not_end_its_work_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    holder_file(tmp_path / LOCK).write_text("7 elsewhere 2026-01-31 12:00:00\n")
    with folder_lock(tmp_path):
        pass
    said = capsys.readouterr().err
    assert said.startswith(f"note: {tmp_path}: process 7 on elsewhere, since 2026-01-31 12:00:00, did not end its work here")
    assert said.count("\n") == 1


WITHOUT_LOCKS = """
import errno, fcntl, sys
from pathlib import Path
def flock(descriptor, operation):
    raise OSError(errno.{}, "no locks here")
fcntl.flock = flock
from tracker.io.file_lock import Locked, file_lock
path = Path(sys.argv[1])
with file_lock(path):
    try:
        with file_lock(path):
            print("held twice")
    except Locked as error:
        print("refused")
with file_lock(path):
    print("held again")
"""


@pytest.mark.command
@pytest.mark.parametrize("number", ["ENOSYS", "ENOLCK", "EOPNOTSUPP"])
def test_a_file_system_without_locks(number: str, tmp_path: Path) -> None:
    """The system call fails as it does there: no such file system can be mounted everywhere."""
    command = [sys.executable, "-c", WITHOUT_LOCKS.format(number), tmp_path / ".lock"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert (done.stdout, done.stderr) == ("refused\nheld again\n", "")
    assert list(tmp_path.iterdir()) == []
