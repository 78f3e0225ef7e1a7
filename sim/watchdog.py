"""A watchdog over calls into the OpenGL driver: one that does not come back ends the process with a line that says so.

A call that hangs in a driver cannot be interrupted from within, so there is nothing to go on with: better an end than an endless wait.
"""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

SECONDS = 120.0
"""What the slowest computer takes for one picture, many times over."""
STATUS = 2

_watch: _Watch | None = None


class _Watch(threading.Thread):
    """Looks now and then whether the deadline of what goes on has passed."""

    def __init__(self) -> None:
        super().__init__(name="watchdog", daemon=True)
        self.process, self.doing, self.deadline = os.getpid(), "", float("inf")

    def run(self) -> None:
        while True:
            left = self.deadline - time.monotonic()
            if left <= 0:
                said = f"error: the OpenGL driver hangs: {self.doing} took more than {SECONDS:g} s\n"
                # Past Python's buffers, whose locks another thread may hold.
                os.write(2, said.encode())
                os._exit(STATUS)
            time.sleep(min(left, SECONDS / 10, 1.0))


@contextmanager
def watched(doing: str) -> Iterator[None]:
    """What is done in this context takes at most SECONDS, else the process ends with one line on its standard error and exit status 2.

    The calls within must let other threads run, as those of ctypes do, by which PyOpenGL calls the driver.
    """
    global _watch
    if _watch is None or _watch.process != os.getpid():
        _watch = _Watch()
        _watch.start()
    watch, before = _watch, (_watch.doing, _watch.deadline)
    watch.doing, watch.deadline = doing, time.monotonic() + SECONDS
    try:
        yield
    finally:
        watch.doing, watch.deadline = before
