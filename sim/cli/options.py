"""Options and helpers that several commands share."""

from __future__ import annotations

import dataclasses
import re
import shlex
from collections.abc import Container, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from tyro.conf import arg

from tracker.options import unset

if TYPE_CHECKING:
    import numpy as np

__all__ = ["DetectorModelName", "Out", "changed_options", "command_line", "ground_area", "json_text", "locked", "options_of", "print_place", "unset"]

Out = Annotated[Path, arg(metavar="DIR")]


def print_place(sequence: Path) -> None:
    """Print what was read, guessed or left out of a user's file, where the place of a sequence was made of one."""
    if (file := sequence / "place.toml").is_file():
        from worlds.world import notes_of

        for note in notes_of(file.read_text(encoding="utf-8")):
            print(note)


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


def command_line(command: Any, without: Container[str], repeated: Container[str] = ()) -> str:
    """The command line that gives a command its changed options. without: options to leave out. repeated: those with their name before each value."""
    name = re.sub("(?<!^)(?=[A-Z])", "-", type(command).__name__).lower()
    words = ["pilsim", name]
    for option, value, usual in options_of(command):
        flag = f"--{option.replace('_', '-')}"
        if option == "source":
            words += [] if value is None else [str(value)]
        elif value == usual or option in without:
            continue
        elif option in repeated:
            words += [word for one in value for word in (flag, one)]
        elif isinstance(value, bool):
            words.append(flag if value else f"--no-{option}")
        else:
            words += [flag, *map(str, value if isinstance(value, tuple) else [value])]
    return shlex.join(words)


@contextmanager
def locked(*files: Path | None) -> Iterator[None]:
    """Lock the files that are written; None is none. Raises ValueError where another process writes one of them."""
    from tracker.io.file_lock import output_file_lock

    with ExitStack() as locks:
        for path in filter(None, files):
            locks.enter_context(output_file_lock(path))
        yield


def json_text(value: Any, indent: int | None = None) -> str:
    """As that of tracker/io/json_files.py, which is imported on demand: the help of a command needs no package of the tracker."""
    from tracker.io.json_files import json_text as text

    return text(value, indent)
