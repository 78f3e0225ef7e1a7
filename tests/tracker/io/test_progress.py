"""Progress on a terminal, in a log, and where standard error fails. Each test runs a child, whose standard error is real."""

import os
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from tracker.io.library_messages import library_messages
from tracker.io.progress import progress_bar

ROOT = Path(__file__).parents[3]
CODE = """
import time
from tracker.io import progress
def pass_by(number, pause):
    with progress.progress_bar(total=number, desc="sums", unit="sum") as bar:
        for _ in progress.progress_bar((k for k in range(number)), desc="places", leave=False):
            time.sleep(pause)
            bar.update()
            bar.set_postfix(rest="none")
            progress.print_line("x")
"""


def child(command: str, streams: str = "") -> subprocess.CompletedProcess[str]:
    """Run Python code after CODE, with the redirections of a shell."""
    words = ["bash", "-c", f'"$0" -c "$1" {streams}', sys.executable, CODE + command]
    return subprocess.run(words, cwd=ROOT, env=dict(os.environ, PYTHONPATH=str(ROOT)), capture_output=True, text=True, check=False)


@pytest.mark.command
def test_short_work_writes_nothing_into_a_log() -> None:
    done = child("pass_by(30, 0.01)")
    assert (done.returncode, done.stderr, done.stdout) == (0, "", "x\n" * 30)


@pytest.mark.command
def test_a_log_has_one_line_for_each_period() -> None:
    done = child("progress._Lines.period = 0.5\nlist(map(lambda _: time.sleep(0.05), progress.progress_bar(range(24), desc='sums', unit='sum')))")
    lines = done.stderr.splitlines()
    assert done.returncode == 0
    assert len(lines) == 2
    assert all(line.startswith("sums: ") and "/24 [" in line for line in lines)


@pytest.mark.soak
def test_the_period_of_a_log_is_ten_seconds() -> None:
    done = child("list(map(lambda _: time.sleep(0.25), progress.progress_bar(range(90), desc='sums')))")
    assert done.stderr.count("\n") == 2, done.stderr


@pytest.mark.command
@pytest.mark.parametrize("streams", ["2>/dev/full", "2>&-", "2> >(true)"])
def test_standard_error_that_fails_does_not_end_the_work(streams: str) -> None:
    done = child("progress._Lines.period = 0.02\npass_by(30, 0.01)", streams)
    assert (done.returncode, done.stdout) == (0, "x\n" * 30)


@pytest.mark.command
def test_a_terminal_shows_a_bar() -> None:
    pty = pytest.importorskip("pty", reason="needs a pseudo-terminal (POSIX)")
    termios = pytest.importorskip("termios")
    ours, theirs = pty.openpty()
    termios.tcsetwinsize(theirs, (24, 80))
    subprocess.run([sys.executable, "-c", f"{CODE}\npass_by(3, 0.01)"], cwd=ROOT, stderr=theirs, stdout=theirs, check=True)
    os.close(theirs)
    shown = b""
    with open(ours, "rb", buffering=0) as file:
        try:
            while part := file.read(1000):
                shown += part
        except OSError:  # The end of a pseudo-terminal without writers.
            pass
    assert b"sums: 100%" in shown
    assert b"3/3" in shown
    assert shown.count(b"x\r\n") == 3


def test_a_line_is_no_message_of_a_library_that_another_thread_collects(capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """Images are read in a thread while the main one shows the progress: its line was taken for a fault of the image."""
    monkeypatch.setattr("tracker.io.progress._Lines.period", 0.0)
    collecting, found = threading.Event(), list[str]()

    def read() -> None:
        with library_messages() as printed:
            collecting.set()
            # The line of the other thread is due now, and waits.
            drawing.join(0.3)
            os.write(2, b"Corrupt JPEG data\n")
        found.append(printed.line)

    def draw() -> None:
        collecting.wait()
        with progress_bar(total=2, desc="tracking") as bar:
            bar.update(1)

    drawing, reading = threading.Thread(target=draw), threading.Thread(target=read)
    drawing.start()
    reading.start()
    reading.join()
    drawing.join()
    assert found == ["Corrupt JPEG data"]
    assert "tracking: " in capfd.readouterr().err
