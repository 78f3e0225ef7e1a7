"""A child process that runs trials one after the other, so that a tracker that hangs or crashes loses its own row only.

The process reads trials as lines on standard input and writes rows as lines on standard output. Output of the tracker goes to standard error.
"""

from __future__ import annotations

import atexit
import contextlib
import json
import os
import select
import subprocess
import sys
import threading
import time
from typing import IO, Any

from sim.parallel.pool import ONE_THREAD
from sim.stress.trial import Trial, empty_row, row_of
from tracker.io.json_files import json_text

POLL = 1.0
"""Time between checks of the parent process, s."""


class Worker:
    """A child process. It starts with the first trial, and is replaced where a trial takes more than `limit` s."""

    def __init__(self, limit: float) -> None:
        self.limit = limit
        self._child: subprocess.Popen[bytes] | None = None
        atexit.register(self.close)

    def row(self, trial: Trial) -> dict[str, Any]:
        """The row of a trial. Where the process crashed or took too long, the row has that error."""
        began = time.perf_counter()
        child = self._child if self._child is not None and self._child.poll() is None else self._start()
        assert child.stdin is not None
        assert child.stdout is not None
        try:
            child.stdin.write(trial.to_json().encode() + b"\n")
            child.stdin.flush()
            answer = _line(child.stdout, began + self.limit)
            fault = f"TimeoutError: took more than {self.limit:g} s and was ended"
        except (BrokenPipeError, EOFError):
            answer = None
            fault = f"RuntimeError: the process ended with status {child.wait()} in the middle of it"
        if answer is None:
            self.close()
            return empty_row(trial) | {"error": fault, "seconds": round(time.perf_counter() - began, 2)}
        row: dict[str, Any] = json.loads(answer)
        return row

    def close(self) -> None:
        """Kill the child process."""
        if self._child is not None:
            self._child.kill()
            self._child.wait()
            for pipe in (self._child.stdin, self._child.stdout):
                # Closing writes what the child has not read, which fails once it has ended.
                with contextlib.suppress(OSError):
                    if pipe is not None:
                        pipe.close()
            self._child = None

    def _start(self) -> subprocess.Popen[bytes]:
        environment = os.environ | dict.fromkeys(ONE_THREAD, "1")
        command = [sys.executable, "-m", "sim.stress.worker"]
        # Ctrl-C in a terminal reaches this process alone, which then ends the child.
        self._child = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=environment, start_new_session=True)
        return self._child


def _line(stream: IO[bytes], until: float) -> bytes | None:
    """The next line, or None where it does not come in time. Raises EOFError where the other end is closed."""
    out = b""
    while not out.endswith(b"\n"):
        left = until - time.perf_counter()
        if left <= 0 or not select.select([stream], [], [], left)[0]:
            return None
        part = os.read(stream.fileno(), 1 << 20)
        if not part:
            raise EOFError
        out += part
    return out


def _watch(parent: int) -> None:
    """End this process when its parent ends, even while a tracker hangs."""
    while os.getppid() == parent:
        time.sleep(POLL)
    os._exit(1)


def main() -> None:
    """Run the trials of standard input until it ends."""
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)
    threading.Thread(target=_watch, args=(os.getppid(),), daemon=True).start()
    for line in sys.stdin:
        print(json_text(row_of(Trial.from_json(line))), file=answers, flush=True)


if __name__ == "__main__":
    main()
