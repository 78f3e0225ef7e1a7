"""Standard streams that cannot end the work: closed, full, or without the characters of a message."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from typing import TextIO, cast, final


@final
class WorkStream:
    """A text stream whose failure does not end the work: the first error of the system is kept in `failure`, and further output is dropped.

    A broken pipe is raised, since nobody reads what the command prints.
    """

    def __init__(self, stream: TextIO, pipes: bool) -> None:
        """pipes: whether a broken pipe is raised, too."""
        self._stream, self._pipes = stream, pipes
        self.failure: OSError | None = None

    def write(self, text: str) -> int:
        """Write text, as TextIO does."""
        self._try(lambda: self._stream.write(text))
        return len(text)

    def flush(self) -> None:
        """Flush, as TextIO does."""
        self._try(self._stream.flush)

    def _try(self, work: Callable[[], object]) -> None:
        if self.failure is not None:
            return
        try:
            work()
        except BrokenPipeError:
            if self._pipes:
                raise
            self._drop(None)
        except OSError as error:
            self._drop(error)

    def _drop(self, error: OSError | None) -> None:
        """Send what is in the buffer, and all that follows, to the null device."""
        self.failure = error or OSError("closed")
        os.dup2(os.open(os.devnull, os.O_WRONLY), self._stream.fileno())

    def __getattr__(self, name: str) -> object:
        """Everything else (encoding, isatty, fileno, buffer) is the stream's own."""
        return getattr(self._stream, name)


def guard_streams() -> WorkStream:
    """Make the standard streams safe, and return standard output.

    A closed stream becomes the null device, so that no file of ours takes its number. Characters that a stream lacks are replaced.
    """
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: SIM115  it lives as long as the process
        stream = getattr(sys, name)
        if not isinstance(stream, WorkStream):
            if callable(reconfigure := getattr(stream, "reconfigure", None)):
                reconfigure(errors="replace")
            setattr(sys, name, WorkStream(stream, pipes=name == "stdout"))
    return cast(WorkStream, sys.stdout)
