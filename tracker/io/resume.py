"""Resumption of runs: a folder that holds the same run is used again, and any other folder is refused.

A mapping of names to JSON values describes a run. It is written to a file in the folder of the run, the statement.
`holds_run` tells whether a folder has a statement. `check_same` compares it with the requested run. A Journal has the parts of an unfinished run.
"""

from __future__ import annotations

import dataclasses
import hashlib
import importlib.metadata
import json
import math
from collections.abc import Callable, Collection, Iterable, Mapping
from fnmatch import fnmatch
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from tracker.io.atomic import is_temporary
from tracker.io.file_lock import folder_lock

T = TypeVar("T")
OTHERWISE = "choose another --out or remove it"
INPUTS = "inputs"
"""Entry of a statement: the checksum of the images and videos of a run."""
LONGEST = 80
"""Most characters of a value in an error message."""


def checksum(file: Path) -> str:
    """SHA-256 of a file, read in parts. It identifies the inputs of runs and the files of manifests."""
    with file.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def checksums(folder: Path, files: Iterable[Path]) -> dict[str, str]:
    """Name in the folder → checksum, for those of `files` that exist."""
    return {file.relative_to(folder).as_posix(): checksum(file) for file in files if file.is_file()}


def holds_run(folder: Path, statement: str, ignored: Collection[str] = ()) -> bool:
    """Whether `folder` holds `statement`, a file path relative to the folder. False where the folder is missing or empty.

    ignored: patterns (fnmatch) of the names that may stand in a folder without a statement.
    Raises ValueError where `folder` is a file, or holds other things and no statement.
    """
    if not folder.exists():
        return False
    if not folder.is_dir():
        raise ValueError(f"{folder}: is a file, needs a folder")
    if (folder / statement).exists():
        return True
    names = sorted(path.name for path in folder.iterdir() if not is_temporary(path.name))
    others = [name for name in names if not any(fnmatch(name, pattern) for pattern in ignored)]
    if others:
        raise ValueError(f"{folder}: holds {others[0]} and no {statement}; {OTHERWISE}")
    return False


def check_same(folder: Path, there: Mapping[str, Any], wanted: Mapping[str, Any], what: str = "another run") -> None:
    """Raises ValueError where an entry of `wanted` differs from the entry of `there` with the same name.

    The order of keys does not matter, and a missing entry equals null. Other entries of `there` are results and are not compared.
    INPUTS, a checksum of images and videos, is compared only where `there` has it, as older versions wrote none.
    what: description of the content of the folder for the message.
    """
    wanted = json_value({name: value for name, value in wanted.items() if name != INPUTS or name in there})
    if INPUTS in wanted and there[INPUTS] != wanted[INPUTS]:
        raise ValueError(f"{folder}: was made of other images or videos than the source has now; {OTHERWISE}")
    difference = _difference({name: there[name] for name in wanted if name in there}, wanted)
    if difference:
        raise ValueError(f"{folder}: holds {what} ({difference}); {OTHERWISE}")


def same_or_new(folder: Path, same: Callable[[], T | None], new: Callable[[], T]) -> T:
    """The result of `same`, which reads the same run, else of `new`, which makes it under the lock of the folder. Raises as both and folder_lock."""
    if (there := same()) is not None:
        return there
    with folder_lock(folder):
        # Another process may have made it before the lock was free.
        return new() if (there := same()) is None else there


class Journal:
    """The parts of an unfinished run, as lines of JSON in its temporary folder: a description of the run, then one line per part.

    about: the description, as JSON values; entries of another run or version are not used. A line truncated by a kill is ignored.
    found: whether a journal of the same run exists; its parts are `entries`. The context manager rewrites the file, and closes it at the end.
    """

    def __init__(self, path: Path, about: Mapping[str, Any]) -> None:
        self._path, self._about = path, json.dumps(about, sort_keys=True)
        self.entries: list[dict[str, Any]] = []
        try:
            first, *lines = path.read_bytes().split(b"\n")[:-1]
        except (OSError, ValueError):
            first, lines = b"", []
        self.found = first == self._about.encode()
        for line in lines if self.found else ():
            try:
                self.entries.append(dict(json.loads(line)))
            except (ValueError, TypeError):
                break

    def __enter__(self) -> Journal:
        temporary = self._path.with_suffix(".new")
        temporary.write_text("".join(f"{line}\n" for line in [self._about, *map(json.dumps, self.entries)]), encoding="utf-8")
        temporary.replace(self._path)
        self._file = self._path.open("a", encoding="utf-8")
        return self

    def __exit__(self, *raised: object) -> None:
        self._file.close()

    def add(self, entry: Mapping[str, Any]) -> None:
        """Append a part. Python's JSON keeps floats exactly, NaN and infinity included."""
        self._file.write(json.dumps(entry) + "\n")
        self._file.flush()

    def remove(self) -> None:
        """Remove the file, once the run is complete."""
        self._path.unlink()


def json_value(value: Any) -> Any:
    """A value converted to JSON types: dataclasses and mappings as objects, tuples and arrays as lists, paths as text.

    Numbers that are not finite become the texts "inf", "-inf" and "nan".
    Raises ValueError for a value of any other type.
    """
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {field.name: json_value(getattr(value, field.name)) for field in dataclasses.fields(value)}
    if isinstance(value, Mapping):
        return {str(name): json_value(entry) for name, entry in value.items()}
    if isinstance(value, (list, tuple)):
        return [json_value(entry) for entry in value]
    if isinstance(value, (np.ndarray, np.generic)):
        return json_value(value.tolist())
    if isinstance(value, Path):
        return str(value)
    if isinstance(value, float):
        return value if math.isfinite(value) else str(value)
    if value is None or isinstance(value, (bool, int, str)):
        return value
    raise ValueError(f"a value is a {type(value).__name__}, needs a JSON type")


def program_version() -> str:
    """The installed version of pilsim, or "unknown" where it is not installed."""
    try:
        return importlib.metadata.version("pilsim")
    except importlib.metadata.PackageNotFoundError:
        return "unknown"


def _difference(there: Any, wanted: Any, name: str = "") -> str:
    """The first entry in which two JSON values differ, as `name value there, value asked for`; "" where they are equal."""
    if isinstance(there, dict) and isinstance(wanted, dict):
        for key in dict.fromkeys([*wanted, *there]):
            path = f"{name}.{key}" if name else key
            if inner := _difference(there.get(key), wanted.get(key), path):
                return inner
        return ""
    return "" if there == wanted else f"{name} {_short(there)} there, {_short(wanted)} asked for"


def _short(value: Any) -> str:
    text = value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)
    return text if len(text) <= LONGEST else f"{text[: LONGEST - 1]}…"
