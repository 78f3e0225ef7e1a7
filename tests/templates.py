"""Folders that many tests read or damage: each is written once a process, and copied for each test."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable, Hashable
from pathlib import Path
from typing import Any, TypeVar

T = TypeVar("T")

_ROOT = tempfile.TemporaryDirectory(prefix="pilsim-tests-")
_MADE: dict[Hashable, tuple[Path, Any]] = {}


def copied(folder: Path, key: Hashable, make: Callable[[Path], T]) -> T:
    """Copy what `make` writes into an empty place to the new folder; returns what it returned. key: tells one template from another."""
    if key not in _MADE:
        place = Path(_ROOT.name, str(len(_MADE)))
        _MADE[key] = place, make(place)
    place, value = _MADE[key]
    shutil.copytree(place, folder)
    return value
