"""Fields of detector models: what a dataclass declares of its numbers, and the reading of such a value from JSON."""

from __future__ import annotations

import json
from collections.abc import Hashable
from dataclasses import MISSING, dataclass, fields, is_dataclass
from functools import cache
from typing import Annotated, Any, TypeVar, get_type_hints

import numpy as np

from tracker.io.text_files import shown

LONGEST = 1e6
"""The largest number, and in s the longest time."""
MOST_SAMPLES = 400
Row = tuple[float, ...]
Table = tuple[Row, ...]
Part = TypeVar("Part")


@dataclass(frozen=True)
class Numbers:
    """What a field holds: numbers from low to high in an array of `shape`, in which 0 stands for any length up to MOST_SAMPLES.

    empty: whether () may stand in place of the array. rising: whether rows must not decrease.
    """

    shape: tuple[int, ...] = ()
    low: float = -LONGEST
    high: float = LONGEST
    empty: bool = False
    rising: bool = False

    def check(self, name: str, value: Any) -> None:
        """Raises ValueError that begins with the name for other values."""
        if value == () and (self.empty or self.shape[:1] == (0,)):
            return
        try:
            found = np.array(value, dtype=np.float64)
        except (TypeError, ValueError):
            found = np.zeros((0,) * 9)
        if found.ndim != len(self.shape) or any(n not in (m, m or n) or n > MOST_SAMPLES for n, m in zip(found.shape, self.shape, strict=True)):
            wanted = " x ".join(str(n) if n else f"at most {MOST_SAMPLES}" for n in self.shape)
            raise ValueError(f"{name} needs {f'{wanted} numbers' if wanted else 'a number'}")
        for at in np.argwhere(~((found >= self.low) & (found <= self.high))).tolist():
            raise ValueError(f"{name}{''.join(f'[{k}]' for k in at)} is {found[tuple(at)]:g}, needs {self.low:g} to {self.high:g}")
        if self.rising and (np.diff(found) < 0).any():
            raise ValueError(f"{name} needs rows that do not fall")


Share = Annotated[float, Numbers((), 0.0, 1.0)]
Time = Annotated[float, Numbers((), 0.0, LONGEST)]
"""s."""
Count = Annotated[float, Numbers((), 0.0, 1000.0)]


@cache
def _hints(cls: Hashable) -> dict[str, Any]:
    return get_type_hints(cls, include_extras=True)


def check_numbers(part: Any, where: str = "") -> None:
    """Raises ValueError, beginning with `where` and the name, for a field of a dataclass whose numbers are not as it declares."""
    for name, hint in _hints(part.__class__).items():
        for declared in getattr(hint, "__metadata__", ()):
            declared.check(f"{where}{name}", getattr(part, name))


def part_of(cls: type[Part], content: Any, name: str) -> Part:
    """The dataclass of a JSON object, whose fields are numbers or such dataclasses. Raises ValueError for other, missing and unknown fields."""
    assert is_dataclass(cls)
    known = {field.name: field for field in fields(cls)}
    needed = {key for key, field in known.items() if field.default is MISSING}
    if not isinstance(content, dict) or not needed <= set(content) <= set(known):
        raise ValueError(f"{name or 'the model'} needs the fields {', '.join(known)}")
    return cls(**{key: frozen(f"{name}.{key}".lstrip("."), value) for key, value in content.items()})


def frozen(name: str, value: Any) -> Any:
    """Numbers, and lists of them as tuples."""
    return tuple(frozen(name, one) for one in value) if isinstance(value, list) else real(name, value)


def real(name: str, value: Any) -> float:
    """A JSON number. Raises ValueError for other values, and for numbers beyond LONGEST."""
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not abs(value) <= LONGEST:
        raise ValueError(f"{name} is {shown(json.dumps(value))[:60]}, needs a number of at most {LONGEST:g}")
    return float(value)
