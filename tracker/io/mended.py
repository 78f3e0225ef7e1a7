"""Faults of input files that a reader mends are counted and logged, in one line a file.

They are warnings of the logger `tracker.mended`. A program without a log of its own writes them to standard error.
"""

from __future__ import annotations

import logging
import os
from pathlib import Path

from tracker.io.time_order import counted

LOG = logging.getLogger("tracker.mended")


def say_repeated(path: str | os.PathLike[str], count: int, noun: str = "row") -> None:
    """Log that `count` repeated rows of a file were merged; nothing where it is 0."""
    if count:
        LOG.warning("%s: %s merged", Path(path), counted(count, f"repeated {noun}"))


def say(note: str) -> None:
    """Log a line on a file; nothing where it is empty."""
    if note:
        LOG.warning("%s", note)
