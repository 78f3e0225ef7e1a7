"""Options and helpers that several commands share."""

from __future__ import annotations

import dataclasses
from collections.abc import Container, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from tyro.conf import arg

from tracker.options import unset

if TYPE_CHECKING:
    import numpy as np

__all__ = ["DetectorModelName", "Out", "changed_options", "ground_area", "json_text", "options_of", "unset"]

Out = Annotated[Path, arg(metavar="DIR")]


def options_of(command: Any, default: Any = None) -> Iterator[tuple[str, Any, Any]]:
    """Name, value and default of each option of a command, options of groups included. default: the group as it is without options."""
    for field in dataclasses.fields(command):
        value, usual = getattr(command, field.name), field.default if default is None else getattr(default, field.name)
        if dataclasses.is_dataclass(value):
            yield from options_of(value, usual)
        else:
            yield field.name, value, usual


def changed_options(command: Any, names: Container[str]) -> dict[str, Any]:
    """Name → value of those options of a command among `names` that differ from their defaults."""
    return {name: value for name, value, usual in options_of(command) if name in names and value != usual}


DetectorModelName = Annotated[str, unset("FILE|NAME", "independent")]
"""The value of --detector-model: a file that `pilsim fit-detector` wrote, or the name of a model of the package."""


def ground_area(text: str) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Parse --area, as in 0,0,7.7,3.4: (2, 2) m, the lowest and highest x, y. Raises ValueError for anything else."""
    import numpy as np

    try:
        area = np.array([float(part) for part in text.split(",")]).reshape(2, 2)
    except ValueError:
        area = np.full((2, 2), np.nan)
    if not (np.isfinite(area).all() and (area[1] > area[0]).all()):
        raise ValueError(f"--area is {text!r}, needs lowest x, lowest y, highest x, highest y in m, as in 0,0,7.7,3.4")
    return area


def json_text(value: Any, indent: int | None = None) -> str:
    """As that of tracker/io/json_files.py, which is imported on demand: the help of a command needs no package of the tracker."""
    from tracker.io.json_files import json_text as text

    return text(value, indent)
