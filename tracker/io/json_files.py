"""Reading JSON files of bounded size, depth and numbers, with errors that name file and line; writing JSON without NaN and Infinity."""

from __future__ import annotations

import json
import math
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tracker.io.atomic import write_text
from tracker.io.text_files import LARGEST_NUMBER, not_utf8, shown

LARGEST_JSON = 1 << 27
"""Bytes."""
DEEPEST = 100
"""Deepest nesting of values. Python's own limit depends on the depth of the caller, and also holds for functions that walk over a value."""
LARGEST_INTEGER = 2**63
LARGEST, LARGEST_ID = 1e9, 2**53 - 1
"""Default bound of the numbers of a field, and the largest id: greater whole numbers are not exact as floats."""
_LONG_NUMBER = re.compile(r"\d{19}|[eE]\+?\d{2}")
"""Every number above the bounds contains this pattern. Most files do not, and the fast parser suffices."""


def read_json(path: Path, largest: int = LARGEST_JSON) -> Any:
    """The JSON value of a file. Raises ValueError with the path and the line for other content.

    largest: bytes that the file may have. Raises ValueError for a larger file, values nested deeper than DEEPEST, and numbers that are not
    finite or out of bounds.
    """
    try:
        if path.stat().st_size > largest:
            raise ValueError(f"{path}: {path.stat().st_size} bytes, needs at most {largest}")
        text = path.read_text(encoding="utf-8-sig")
    except FileNotFoundError:
        raise ValueError(f"{path}: no such file") from None
    except UnicodeDecodeError:
        raise not_utf8(path) from None
    return _parsed(text, str(path), f"{path}:{{line}}")


def write_json(path: Path, value: Any, indent: int | None = None) -> None:
    """Write a value as JSON atomically; read_json reads it. Raises ValueError for numbers that are not finite."""
    write_text(path, json.dumps(value, indent=indent, allow_nan=False) + "\n")


def json_text(value: Any, indent: int | None = None) -> str:
    """A value as JSON, where numbers that are not finite become null. RFC 8259 has neither NaN nor Infinity, and most readers refuse them."""
    return json.dumps(_finite(value), indent=indent, allow_nan=False)


def _finite(value: Any) -> Any:
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, dict):
        return {name: _finite(entry) for name, entry in value.items()}
    return [_finite(entry) for entry in value] if isinstance(value, (list, tuple)) else value


def parse_json(text: str, where: str) -> Any:
    """The JSON value of a text. Raises ValueError that begins with `where` as read_json does."""
    return _parsed(text, where, where)


@dataclass(frozen=True)
class JsonObject:
    """An object of a JSON file, read with a check of types. where: the file and the fields that lead to it, with which every error begins."""

    values: dict[str, Any]
    where: str

    def __post_init__(self) -> None:
        if not isinstance(self.values, dict):
            raise ValueError(f"{self.where}: a JSON {type(self.values).__name__}, needs an object")

    def check_schema(self, schema: int, writer: str = "") -> None:
        """Raises ValueError for a file of another schema. writer: text for the end of the message."""
        if (found := self.values.get("schema")) != schema:
            raise ValueError(f"{self.where}: schema is {shown(str(found))[1:-1]}, this version reads {schema}{writer}")

    def a(self, name: str, kind: type) -> Any:
        """The value of a field. Raises ValueError where it is missing, or of another type; a boolean is no number."""
        value = self.values.get(name)
        if not isinstance(value, kind) or (isinstance(value, bool) and kind is not bool):
            raise ValueError(f"{self.where}: {name} is {'missing' if value is None else type(value).__name__}, needs {kind.__name__}")
        return value

    def maybe(self, name: str, kind: type) -> Any:
        """As `a`, and None for a field that is missing or null."""
        return None if self.values.get(name) is None else self.a(name, kind)

    def array(self, name: str, shape: tuple[int, ...] = (), low: float = -LARGEST, high: float = LARGEST, meaning: str = "") -> NDArray[np.float64]:
        """The numbers of a field, of this shape and from low to high. −1 in the shape is any length. A row may be given as a column, as OpenCV does.

        Raises ValueError for another value, and says what the numbers mean.
        """
        value = self.values.get(name)
        try:
            found = np.array(value)
        except (ValueError, OverflowError):
            found = np.array(None)
        if len(shape) == 1 and found.shape == (*shape, 1):
            found = found[:, 0]
        if shape[:1] == (-1,):
            shape = (len(found) if found.ndim else 0, *shape[1:])
            found = np.zeros(shape) if found.shape == (0,) else found
        if found.shape != shape or found.dtype.kind not in "iuf" or not ((found >= low) & (found <= high)).all():
            count = f"{' x '.join(map(str, shape))} numbers" if shape else "a number"
            raise self.refused(name, f"{count} from {low:g} to {high:g}{meaning and ': '}{meaning}")
        return found.astype(np.float64)

    def number(self, name: str, low: float = -LARGEST, high: float = LARGEST, meaning: str = "") -> float:
        """As `array`, one number."""
        return float(self.array(name, (), low, high, meaning))

    def whole(self, name: str, low: int = 0, high: int = LARGEST_ID) -> int:
        """The whole number of a field, from low to high."""
        value = self.values.get(name)
        if isinstance(value, bool) or not (isinstance(value, int) or (isinstance(value, float) and value.is_integer())) or not low <= value <= high:
            raise self.refused(name, f"a whole number from {low} to {high}")
        return int(value)

    def text(self, name: str, pattern: str, needed: str) -> str:
        """The text of a field that matches a pattern. needed: what that is, for the message."""
        value = self.values.get(name)
        if not isinstance(value, str) or not re.fullmatch(pattern, value):
            raise self.refused(name, needed)
        return value

    def refused(self, name: str, needed: str) -> ValueError:
        """The error of a field that is not what is needed."""
        value = self.values.get(name)
        return ValueError(f"{self.where}: {name} is {'missing' if value is None else repr(value)[:80]}, needs {needed}")

    def objects(self, name: str) -> list[JsonObject]:
        """The objects of a list."""
        return [JsonObject(value, f"{self.where}: {name}[{k}]") for k, value in enumerate(self.a(name, list))]

    def part(self, name: str) -> JsonObject:
        """The object of a field."""
        if name not in self.values:
            raise ValueError(f"{self.where}: {name} is missing, needs an object")
        return JsonObject(self.values[name], f"{self.where}: {shown(name)[1:-1]}")

    def parts(self, name: str) -> dict[str, JsonObject]:
        """Name → object of all fields of the object `name`; none where it is missing or null."""
        whole = JsonObject({}, "") if self.values.get(name) is None else self.part(name)
        return {key: whole.part(key) for key in whole.values}

    def numbers(self) -> dict[str, float]:
        """The numbers that are not null. Raises ValueError for a value that is neither a number nor null."""
        for name, value in self.values.items():
            if value is not None and (isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value)):
                raise ValueError(f"{self.where}: {shown(name)[1:-1]} is {shown(str(value))}, needs a finite number or null")
        return {name: value for name, value in self.values.items() if value is not None}

    def integers(self, name: str, count: int | None = None) -> list[int]:
        """The whole numbers of a list. count: how many there must be."""
        found = self.a(name, list)
        if not all(isinstance(value, int) and not isinstance(value, bool) for value in found):
            raise ValueError(f"{self.where}: {name} holds other values than integers")
        if count not in (None, len(found)):
            raise ValueError(f"{self.where}: {name} has {len(found)} values, needs {count}")
        return found


def _parsed(text: str, where: str, at_line: str) -> Any:
    def refuse(constant: str) -> Any:
        raise ValueError(f"{where}: holds {constant}, needs finite numbers")

    def number(token: str) -> float:
        value = float(token)
        if not abs(value) <= LARGEST_NUMBER:
            raise ValueError(f"{at(text.find(token))}: holds {shown(token)}, needs numbers of at most {LARGEST_NUMBER:g}")
        return value

    def integer(token: str) -> int:
        if len(token) > 20 or not -LARGEST_INTEGER <= int(token) < LARGEST_INTEGER:
            raise ValueError(f"{at(text.find(token))}: holds {shown(token)}, needs whole numbers below 2^63")
        return int(token)

    def at(place: int) -> str:
        return at_line.format(line=text.count("\n", 0, max(place, 0)) + 1) if at_line != where else where

    if _deeper(text):
        raise ValueError(f"{where}: nested too deep, needs at most {DEEPEST} values within each other")
    try:
        if _LONG_NUMBER.search(text):
            return json.loads(text, parse_constant=refuse, parse_float=number, parse_int=integer)
        return json.loads(text, parse_constant=refuse)
    except json.JSONDecodeError as error:
        raise ValueError(f"{at(error.pos)}: not JSON ({error.msg})") from None


def _deeper(text: str) -> bool:
    """Whether brackets are nested deeper than DEEPEST. Brackets in strings count, too: they come in pairs, or are few."""
    if text.count("[") + text.count("{") <= DEEPEST:
        return False
    depth = 0
    for start in range(0, len(text), 1 << 20):
        code = np.frombuffer(text[start : start + (1 << 20)].encode("latin-1", "replace"), dtype=np.uint8)
        steps = np.isin(code, (0x5B, 0x7B)).astype(np.int32) - np.isin(code, (0x5D, 0x7D))
        levels = depth + np.cumsum(steps)
        if levels.size and levels.max() > DEEPEST:
            return True
        depth = int(levels[-1]) if levels.size else depth
    return False
