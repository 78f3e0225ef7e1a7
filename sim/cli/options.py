"""Options and helpers that several commands share."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from tyro.conf import arg

if TYPE_CHECKING:
    import numpy as np

Out = Annotated[Path, arg(metavar="DIR")]


def unset(metavar: str, meaning: str) -> Any:
    """The help of an option without a default value: the name of its value, and the meaning of its absence in place of `None`."""
    return arg(metavar=metavar, help_behavior_hint=f"(default: {meaning})")


def options_of(command: Any) -> Iterator[tuple[str, Any, Any]]:
    """Name, value and default of each option of a command, options of groups included."""
    for field in dataclasses.fields(command):
        value = getattr(command, field.name)
        if dataclasses.is_dataclass(value):
            yield from options_of(value)
        else:
            yield field.name, value, field.default


DetectorModelName = Annotated[str, unset("FILE|NAME", "independent")]
"""The value of --detector-model: a file that `pilsim fit-detector` wrote, or the name of a model of the package."""


def numbers(text: str) -> list[int]:
    """Parse numbers of views, as in 1,5,7. Raises ValueError for anything else."""
    try:
        return [int(part) for part in text.split(",") if part.strip()]
    except ValueError:
        raise ValueError(f"--views is {text!r}, needs numbers as in 1,5,7") from None


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
