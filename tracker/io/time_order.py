"""Rows with times out of order: rows that step back a little are sorted, repeated rows are merged, and both are counted.

Readers log what they repaired as warnings of the logger `tracker.mended`, a line per file. Without a handler, Python prints them on standard error.
"""

from __future__ import annotations

import logging
import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tracker.geometry import Array, Ints

LOG = logging.getLogger("tracker.mended")
_SAID: set[str] = set()
LARGEST_STEP_BACK = 0.5
"""s: rows that step back by less are sorted. Logs that several threads of a robot write step back by 0.1 s; a clock that was set jumps by seconds."""


@dataclass(frozen=True, eq=False)
class TimeOrder:
    """The order of rows by time.

    rows (m,): indices of the rows to keep, in order of time. late: number of rows that come after a row of a later time.
    step_back: the largest such difference, s. repeated: number of rows left out because they equal another in every column.
    """

    rows: Ints
    late: int
    step_back: float
    repeated: int

    def note(self, name: str) -> str:
        """One line on what was sorted and merged in the file `name`; empty where nothing was."""
        parts = [f"{counted(self.late, 'row')} out of order by up to {self.step_back:.2f} s sorted"] if self.late else []
        parts += [f"{counted(self.repeated, 'repeated row')} merged"] if self.repeated else []
        return f"{name}: {', '.join(parts)}" if parts else ""


def time_order(rows: Array) -> TimeOrder:
    """The order of rows (n, columns), whose first column is the time in s. Rows of one time stay in their order; of repeated rows the last stays."""
    times = rows[:, 0]
    back = np.maximum.accumulate(times) - times if len(times) else times
    order = np.argsort(times, kind="stable")
    same = np.diff(times[order]) == 0
    twin = np.zeros(len(times), dtype=bool)
    twin[1:] |= same
    twin[:-1] |= same
    keep = np.ones(len(times), dtype=bool)
    if twin.any():
        among = order[twin][::-1]
        keep[among] = False
        keep[among[np.unique(rows[among], axis=0, return_index=True)[1]]] = True
    return TimeOrder(order[keep[order]], int((back > 0).sum()), float(back.max(initial=0.0)), int((~keep).sum()))


def first_large_step_back(times: Array) -> tuple[int, int] | None:
    """Index of the first of times (n,) s that lies LARGEST_STEP_BACK or more below an earlier one, and of the largest earlier one; or None."""
    if not len(times):
        return None
    fault = np.maximum.accumulate(times) - times >= LARGEST_STEP_BACK
    if not fault.any():
        return None
    k = int(np.argmax(fault))
    return k, int(np.argmax(times[:k]))


def counted(number: int, noun: str) -> str:
    """A number with its noun, in the plural where it is not 1."""
    return f"{number} {noun}{'' if number == 1 else 's'}"


def say(line: str) -> None:
    """Log how a reader interpreted ambiguous input. A line is logged once, as a source may be read several times."""
    if line not in _SAID:
        _SAID.add(line)
        LOG.warning("%s", line)


def say_repeated(path: str | os.PathLike[str], count: int, noun: str = "row") -> None:
    """Log that `count` repeated rows of a file were merged; nothing where it is 0."""
    if count:
        LOG.warning("%s: %s merged", Path(path), counted(count, f"repeated {noun}"))
