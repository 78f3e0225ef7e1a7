"""Messages that C libraries print on standard error while they read a file: they are collected, and not shown."""

from __future__ import annotations

import os
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager

standard_error = threading.RLock()
"""A thread holds it while it collects messages. Other threads hold it while they write to standard error, so that their text is not collected."""


class Printed:
    """The first line that was printed, "" for nothing."""

    line = ""


@contextmanager
def library_messages() -> Iterator[Printed]:
    """Collect what is written to file descriptor 2 during the block, as C libraries do. Without this descriptor, nothing is collected."""
    out = Printed()
    with standard_error, tempfile.TemporaryFile() as file:
        try:
            own = os.dup(2)
        except OSError:
            yield out
            return
        try:
            os.dup2(file.fileno(), 2)
            try:
                yield out
            finally:
                os.dup2(own, 2)
        finally:
            os.close(own)
            file.seek(0)
            out.line = file.readline(200).decode("utf-8", "replace").strip()
