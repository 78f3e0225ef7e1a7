"""Progress of long work on standard error: a bar on a terminal, a line every 10 s elsewhere. Its errors never stop the work."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from time import monotonic
from typing import Any

from tqdm import tqdm

from tracker.io.library_messages import standard_error

PERIOD = 10.0
"""Time between two lines where standard error is no terminal, s. Work that is shorter writes none."""
LINE = "{desc}: {n_fmt}/{total_fmt} [{elapsed}<{remaining}, {rate_fmt}{postfix}]"


class _Bar(tqdm):  # type: ignore[misc]
    """A bar of tqdm that stops being drawn where standard error is closed, full or broken."""

    period = 0.5
    """Time between two visible states, s. Callers that set `n` themselves need not call `refresh` more often."""

    def display(self, *given: Any, **named: Any) -> Any:
        """Draw the bar, as tqdm does."""
        return self._try(super().display, *given, **named)

    def clear(self, *given: Any, **named: Any) -> Any:
        """Erase the bar, as tqdm does."""
        return self._try(super().clear, *given, **named)

    def close(self) -> Any:
        """End the bar, as tqdm does."""
        return self._try(super().close)

    def _try(self, draw: Any, *given: Any, **named: Any) -> Any:
        try:
            # Without the lock, a thread that decodes an image would collect this text as a message of the decoder.
            with standard_error:
                return draw(*given, **named)
        except (OSError, ValueError):
            # ValueError is raised for a closed file, and for characters that it lacks.
            self.disable = True
            return False


class _Lines(_Bar):
    """The same for a log: each state is a line of its own, at least `period` s after the last."""

    period = PERIOD
    monitor_interval = 0  # Only bars need tqdm's monitor thread.

    def __init__(self, *given: Any, **named: Any) -> None:
        self._shown = monotonic()
        super().__init__(*given, **named)

    def display(self, *_: Any, **__: Any) -> bool:
        """Write a line where the last one is old enough."""
        if monotonic() - self._shown < self.period:
            return False
        self._shown = monotonic()
        return bool(self._try(self._line))

    def _line(self) -> bool:
        self.fp.write(f"{self}\n")
        self.fp.flush()
        return True

    def clear(self, *_: Any, **__: Any) -> None:
        """Nothing is erased in a log."""

    def close(self) -> None:
        """End the work without a line."""
        if not self.disable:
            self.disable = True
            self._decr_instances(self)


def progress_bar(items: Iterable[Any] | None = None, total: int | None = None, **options: Any) -> Any:
    """Iterate over items and show the progress on standard error; without items, the object that tqdm gives: `update`, `n`, `close`, a context.

    A terminal shows a bar. Elsewhere a line is written every 10 s, and none for shorter work. Errors of standard error are ignored.
    options: as of tqdm, for example desc, unit, leave, disable.
    """
    terminal = _is_terminal()
    if terminal is None:
        options["disable"] = True
    if terminal:
        return _Bar(items, total=total, **options)
    if total is None and hasattr(items, "__len__"):
        total = len(items)  # type: ignore[arg-type]
    form = {} if total is None else {"bar_format": LINE}
    return _Lines(items, total=total, miniters=1, ascii=True, **options, **form)


def print_line(text: str) -> None:
    """Print a line on standard output, above the bars of a terminal."""
    _Bar.write(text, file=sys.stdout)


def _is_terminal() -> bool | None:
    """Whether standard error is a terminal; None where it is absent or closed."""
    try:
        return None if sys.stderr is None else sys.stderr.isatty()
    except (OSError, ValueError):
        return None
