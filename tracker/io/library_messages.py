"""What C libraries print on standard error while they read a file: it is collected, and is no output of ours."""

from __future__ import annotations

import os
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager

standard_error = threading.RLock()
"""Who holds it is the only one that collects messages. Other threads hold it while they write to standard error, so that theirs are not collected."""


class Printed:
    """The first line that was printed, "" for nothing."""

    line = ""


@contextmanager
def library_messages() -> Iterator[Printed]:
    """Collect what is printed on standard error in the block, and what libraries print to no Python stream. Where there is none, nothing is."""
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
