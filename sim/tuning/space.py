"""The space of a search: parameters with their ranges or choices, from a TOML file.

    [gate]
    range = [2.0, 12.0]
    [arrival_rate]
    range = [1e-5, 1e-2]
    log = true
    [k_h]
    range = [1, 5]
    ["detection_rates.learned"]
    choices = [false, true]

A range with integer ends gives integers. `space.toml` beside this file is the space of pilsim's own tracker.
"""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tracker.parameter_file import Value, field_value, read_toml
from tracker.tracks.parameters import MhtParameters

if TYPE_CHECKING:
    from optuna.trial import Trial

OWN_SPACE = Path(__file__).with_name("space.toml")
_KEYS = {"range", "log", "choices"}


@dataclass(frozen=True)
class SearchRange:
    """A parameter: its name, and lowest and highest value, or choices (then low and high are 0). log: whether the scale is logarithmic."""

    name: str
    low: float = 0.0
    high: float = 0.0
    log: bool = False
    choices: tuple[Value, ...] = ()

    @property
    def whole(self) -> bool:
        return not self.choices and isinstance(self.low, int) and isinstance(self.high, int)

    def holds(self, value: Any) -> bool:
        """Whether a value is one of the range."""
        if self.choices:
            return any(value == one and type(value) is type(one) for one in self.choices)
        return isinstance(value, int | float) and not isinstance(value, bool) and self.low <= value <= self.high

    def draw(self, rng: np.random.Generator) -> Value:
        """A random value: uniform over choices, otherwise uniform on the scale of the range."""
        if self.choices:
            return self.choices[int(rng.integers(len(self.choices)))]
        if self.whole and self.log:
            # Each integer stands for half a unit around it, as for Optuna.
            drawn = np.exp(rng.uniform(np.log(self.low - 0.5), np.log(self.high + 0.5)))
            return int(np.clip(np.rint(drawn), self.low, self.high))
        if self.whole:
            return int(rng.integers(int(self.low), int(self.high) + 1))
        if self.log:
            return float(np.clip(np.exp(rng.uniform(np.log(self.low), np.log(self.high))), self.low, self.high))
        return float(rng.uniform(self.low, self.high))

    def suggest(self, trial: Trial) -> Value:
        """The value of a trial of Optuna."""
        if self.choices:
            chosen: Any = trial.suggest_categorical(self.name, self.choices)
            return chosen
        if self.whole:
            return trial.suggest_int(self.name, int(self.low), int(self.high), log=self.log)
        return trial.suggest_float(self.name, self.low, self.high, log=self.log)


Space = tuple[SearchRange, ...]


def read_space(path: Path) -> Space:
    """The space of a file. Raises ValueError, in one line with the path, for no parameter, an empty range, and other content."""
    content = _flat(read_toml(path), "")
    if not content:
        raise ValueError(f"{path}: has no parameter, needs one at least, as [gate] with range = [2.0, 12.0]")
    return tuple(_range(name, entry, f"{path}: {name}") for name, entry in content.items())


def _flat(content: Mapping[str, Any], before: str) -> dict[str, Any]:
    """Entries by path: [motion.foot_spread] is the same as ["motion.foot_spread"]."""
    out: dict[str, Any] = {}
    for name, entry in content.items():
        if isinstance(entry, dict) and entry and not _KEYS & set(entry) and all(isinstance(one, dict) for one in entry.values()):
            out |= _flat(entry, f"{before}{name}.")
        else:
            out[before + name] = entry
    return out


def _range(name: str, entry: Any, where: str) -> SearchRange:
    if not isinstance(entry, dict) or ("range" in entry) == ("choices" in entry) or set(entry) - _KEYS or ("choices" in entry and "log" in entry):
        raise ValueError(f"{where} needs range = [LOW, HIGH], with log = true on a logarithmic scale, or choices = [...]")
    if "choices" in entry:
        choices = entry["choices"]
        if not isinstance(choices, list) or not all(isinstance(one, bool | int | float | str) for one in choices) or len(choices) < 2:
            raise ValueError(f"{where}: choices is {str(choices)[:60]}, needs two values at least")
        if len({(type(one), one) for one in choices}) < len(choices):
            raise ValueError(f"{where}: choices has a value twice")
        return SearchRange(name, choices=tuple(choices))
    ends, log = entry["range"], entry.get("log", False)
    number = isinstance(ends, list) and len(ends) == 2 and all(type(v) in (int, float) and math.isfinite(v) for v in ends)
    if not number or not isinstance(log, bool):
        raise ValueError(f"{where}: range is {str(ends)[:60]}, needs two finite numbers; log needs true or false")
    low, high = ends
    if not low < high:
        raise ValueError(f"{where}: the range from {low} to {high} is empty, needs the lower end first")
    if log and low <= 0:
        raise ValueError(f"{where}: the range begins at {low}, needs more than 0 on a logarithmic scale")
    whole = isinstance(low, int) and isinstance(high, int)
    return SearchRange(name, low if whole else float(low), high if whole else float(high), log)


def own_defaults(space: Space, where: str) -> dict[str, Value]:
    """Defaults of pilsim's own tracker. Raises ValueError that begins with `where` for an unknown parameter and for values of another type."""
    out: dict[str, Value] = {}
    for one in space:
        out[one.name] = default = field_value(MhtParameters(), one.name, f"{where}: parameter")
        fits = all(type(value) is type(default) for value in one.choices) and (one.choices or type(default) in (float, int)[: 1 + one.whole])
        if not fits:
            raise ValueError(f"{where}: {one.name} is {default!r} by default, needs a range or choices of such values")
    return out


def function_defaults(function: Callable[..., Any], space: Space, where: str) -> dict[str, Value]:
    """Defaults of the keyword arguments of a tracker; unknown ones of **keywords are left out.

    The best parameters are compared with the default ones.
    So it raises ValueError for an argument that it does not have, and for one without a default.
    """
    known = inspect.signature(function).parameters
    anything = any(one.kind is one.VAR_KEYWORD for one in known.values())
    out: dict[str, Value] = {}
    for one in space:
        if one.name not in known and not anything:
            keywords = ", ".join(name for name, found in known.items() if found.default is not found.empty)
            raise ValueError(f"{where}: the tracker has no argument {one.name}, needs one of {keywords or 'its keyword arguments: it has none'}")
        if one.name in known and known[one.name].default is inspect.Parameter.empty:
            raise ValueError(f"{where}: {one.name} has no default in the tracker, needs one")
        if one.name in known:
            out[one.name] = known[one.name].default
    return out
