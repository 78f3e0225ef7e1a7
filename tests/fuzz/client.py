"""The test's side of a worker: it starts the process, gives it orders, and replaces it where an input ends it or keeps it too long."""

from __future__ import annotations

import json
import os
import selectors
import subprocess
import sys
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]


class Client:
    """A worker process, started with the first order. Use it as a context manager."""

    def __init__(self) -> None:
        self._child: subprocess.Popen[bytes] | None = None

    def __enter__(self) -> Client:
        return self

    def __exit__(self, *error: object) -> None:
        if self._child is not None:
            self._child.kill()
            self._child.communicate()
            self._child = None

    def ask(self, order: dict[str, Any], limit: float) -> dict[str, Any]:
        """The answer of the worker: inputs, refused and faults; or one fault where it ended or took more than `limit` s for all inputs."""
        if self._child is None:
            command = [sys.executable, "-m", "tests.fuzz.worker"]
            environment = os.environ | {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
            self._child = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, cwd=ROOT, env=environment)
        child = self._child
        assert child.stdin is not None
        assert child.stdout is not None
        child.stdin.write(json.dumps(order).encode() + b"\n")
        child.stdin.flush()
        with selectors.DefaultSelector() as wait:
            wait.register(child.stdout, selectors.EVENT_READ)
            line = child.stdout.readline() if wait.select(limit) else b""
        if line:
            answer: dict[str, Any] = json.loads(line)
            return answer
        status = child.poll()
        self.__exit__()
        message = f"took more than {limit:g} s" if status is None else f"the process ended with status {status}"
        return {"inputs": 0, "refused": 0, "faults": {message: {"message": message, "count": 1, "input": "unknown"}}}
