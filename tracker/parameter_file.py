"""Files of parameters (TOML): values of single fields by their paths, as `pilsim tune` writes them for `--parameters`.

    residence = 50.0
    "motion.foot_spread" = 0.3
    "detection_rates.log_ratios.0" = 0.5

A path leads through the parts of tracker.tracks.parameters.MhtParameters; a number in it is a place in a tuple.
"""

from __future__ import annotations

import dataclasses
import math
import tomllib
from collections.abc import Mapping
from difflib import get_close_matches
from pathlib import Path
from typing import Any, TypeVar

from tracker.io.text_files import read_text, shown

MAX_BYTES = 1 << 20
Value = bool | int | float | str
T = TypeVar("T")


def read_toml(path: Path) -> dict[str, Any]:
    """The content of a TOML file. Raises ValueError, in one line with the path, for a missing or invalid file."""
    if not path.is_file():
        raise ValueError(f"{path}: {'is a folder, needs a file' if path.is_dir() else 'no such file'}")
    try:
        return tomllib.loads(read_text(path, MAX_BYTES))
    except tomllib.TOMLDecodeError as error:
        raise ValueError(f"{path}: not TOML ({shown(str(error))[1:-1]})") from None
    except RecursionError:
        raise ValueError(f"{path}: nested too deep") from None


def read_parameters(path: Path) -> dict[str, Value]:
    """Values by path; tables are the same as paths with dots. Raises ValueError, in one line with the path of the file, for other content."""
    out: dict[str, Value] = {}

    def add(content: Mapping[str, Any], before: str) -> None:
        for name, value in content.items():
            if isinstance(value, dict):
                add(value, f"{before}{name}.")
            elif isinstance(value, bool | str | int) or (isinstance(value, float) and math.isfinite(value)):
                out[before + name] = value
            else:
                raise ValueError(f"{path}: {before}{name} is {shown(str(value))[:60]}, needs a finite number, a truth value or a text")

    add(read_toml(path), "")
    return out


def parameters_text(values: Mapping[str, Value], comments: tuple[str, ...] = ()) -> str:
    """The text of a file of parameters, which `read_parameters` reads back exactly."""
    lines = [f"# {comment}" for comment in comments]
    for name, value in values.items():
        text = str(value).lower() if isinstance(value, bool) else _quoted(value) if isinstance(value, str) else repr(value)
        lines.append(f"{name if name.replace('_', '').replace('-', '').isalnum() and name.isascii() else _quoted(name)} = {text}")
    return "\n".join(lines) + "\n"


def with_fields(parameters: T, values: Mapping[str, Value], where: str = "parameter") -> T:
    """Parameters (a dataclass) with other values of fields, by their paths.

    Raises ValueError that begins with `where` for an unknown path, or for a value of another type than the field.
    """
    for path, value in values.items():
        parameters = _with_field(parameters, path.split("."), value, f"{where} {path}")
    return parameters


def field_value(parameters: Any, path: str, where: str = "parameter") -> Value:
    """The value at a path. Raises ValueError that begins with `where` for an unknown one."""
    for name in path.split("."):
        parameters = _part(parameters, name, f"{where} {path}")
    if dataclasses.is_dataclass(parameters) or isinstance(parameters, tuple):
        raise ValueError(f"{where} {path} has parts, needs the path of one of them, as {path}.{_names(parameters)[0]}")
    found: Value = parameters
    return found


def _with_field(parameters: Any, names: list[str], value: Value, where: str) -> Any:
    old = _part(parameters, names[0], where)
    new = _with_field(old, names[1:], value, where) if len(names) > 1 else _of_kind(old, value, where)
    if isinstance(parameters, tuple):
        return (*parameters[: int(names[0])], new, *parameters[int(names[0]) + 1 :])
    try:
        return dataclasses.replace(parameters, **{names[0]: new})
    except ValueError as error:
        raise ValueError(f"{where}: {error}") from None


def _part(parameters: Any, name: str, where: str) -> Any:
    known = _names(parameters)
    if name not in known:
        near = get_close_matches(name, known, 1, 0.7)
        needed = f"did you mean {near[0]}?" if near else f"needs one of {', '.join(known)}" if known else "it has no parts"
        raise ValueError(f"{where} is unknown; {needed}")
    return parameters[int(name)] if isinstance(parameters, tuple) else getattr(parameters, name)


def _names(parameters: Any) -> list[str]:
    if isinstance(parameters, tuple):
        return [str(k) for k in range(len(parameters))]
    return [f.name for f in dataclasses.fields(parameters)] if dataclasses.is_dataclass(parameters) else []


def _of_kind(old: Any, value: Value, where: str) -> Value:
    """The value in the type of the field: a whole number may replace a real one, but not the reverse."""
    if isinstance(old, float) and isinstance(value, int) and not isinstance(value, bool):
        return float(value)
    if type(old) is not type(value):
        kinds = {bool: "true or false", int: "a whole number", float: "a number", str: "a text"}
        raise ValueError(f"{where} is {value!r}, needs {kinds.get(type(old), 'the path of one of its parts')}")
    return value


def _quoted(text: str) -> str:
    escaped = text.replace("\\", "\\\\").replace('"', '\\"')
    return '"' + "".join(f"\\u{ord(c):04x}" if ord(c) < 32 or ord(c) == 127 else c for c in escaped) + '"'
