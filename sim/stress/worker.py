"""A process that runs trials one after the other, so that a tracker that hangs or crashes loses its own row only."""

from __future__ import annotations

import json
import time
from concurrent.futures import Executor
from contextlib import ExitStack
from typing import Any

from sim.parallel.pool import processes
from sim.stress.trial import Trial, empty_row, row_of
from tracker.io.json_files import json_text


class Worker:
    """A process. It starts with the first trial, and is replaced where a trial takes more than `limit` s."""

    def __init__(self, limit: float) -> None:
        self.limit = limit
        self._stack = ExitStack()
        self._executor: Executor | None = None

    def row(self, trial: Trial) -> dict[str, Any]:
        """The row of a trial. Where the process crashed or took too long, the row has that error."""
        began = time.perf_counter()
        if self._executor is None:
            self._executor = self._stack.enter_context(processes(1, __name__))
        future = self._executor.submit(plain_row, trial)
        try:
            if (error := future.exception(self.limit)) is None:
                return dict(future.result())
            fault = f"RuntimeError: the process ended in the middle of it ({type(error).__name__})"
        except TimeoutError:
            fault = f"TimeoutError: took more than {self.limit:g} s and was ended"
        self.close()
        return empty_row(trial) | {"error": fault, "seconds": round(time.perf_counter() - began, 2)}

    def close(self) -> None:
        """Kill the process."""
        self._executor = None
        self._stack.close()


def plain_row(trial: Trial) -> dict[str, Any]:
    """The row of a trial as JSON has it: numbers that are not finite are None."""
    return dict(json.loads(json_text(row_of(trial))))
