"""Clocks of robots and cameras: a constant offset, a drift, and jitter of single time stamps."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

import numpy as np

from tracker.geometry import Array

LIMITS: dict[str, float] = {"offset": 1000.0, "jitter": 1.0, "drift": 10_000.0}
"""Largest value of each error: offset s, jitter s (one sigma), drift ppm."""
_GRAMMAR = "[NAME:]offset=S,jitter=S,drift=PPM, more of them after ;"
_DRAWN = ("±", "+-")


@dataclass(frozen=True)
class Clock:
    """A clock: offset s, drift ppm, and jitter s, one sigma of each stamp. It shows t·(1 + drift·1e-6) + offset at the time t."""

    offset: float = 0.0
    drift: float = 0.0
    jitter: float = 0.0

    def stamps(self, time: Array, rng: np.random.Generator) -> Array:
        """Time stamps (n,) s of the true times (n,) s."""
        noise = rng.normal(0.0, 1.0, len(time))
        if self == Clock():
            return time.copy()
        return time * (1 + self.drift * 1e-6) + self.offset + self.jitter * noise


@dataclass(frozen=True)
class ClockSpecification:
    """Requested errors of a clock. drawn: names of the errors whose value is the standard deviation of a normal distribution."""

    value: Clock
    drawn: frozenset[str]

    def draw(self, rng: np.random.Generator) -> Clock:
        """A clock of this specification."""
        offset, drift = rng.normal(0.0, 1.0, 2)
        value = self.value
        return Clock(
            value.offset * (offset if "offset" in self.drawn else 1.0), value.drift * (drift if "drift" in self.drawn else 1.0), value.jitter
        )


def parse_clocks(text: str) -> dict[str, ClockSpecification]:
    """Name of a robot or camera → specification of its clock; the name "" stands for all others.

    Example: offset=0.02,jitter=0.001;robot_0_camera:offset=±0.05,drift=20. A value after ± is the standard deviation of a random value.
    Raises ValueError for another text, an error or a name that occurs twice, and a value out of LIMITS.
    """
    found: dict[str, ClockSpecification] = {}
    for part in text.split(";"):
        name, colon, errors = part.strip().rpartition(":")
        if colon and not re.fullmatch(r"\w+", name):
            raise ValueError(f"clock has the name {name[:60]!r}, needs {_GRAMMAR}")
        if name in found:
            raise ValueError(f"clock names {name or 'all clocks'} twice")
        found[name] = _specification(errors)
    return found


def _specification(text: str) -> ClockSpecification:
    values, drawn = dict[str, float](), set[str]()
    for item in text.split(","):
        name, equals, number = (part.strip() for part in item.partition("="))
        if not equals or name not in LIMITS:
            raise ValueError(f"clock has {item.strip()[:60]!r}, needs {_GRAMMAR}")
        if name in values:
            raise ValueError(f"clock has {name} twice")
        sign = next((sign for sign in _DRAWN if number.startswith(sign)), "")
        if sign:
            if name == "jitter":
                raise ValueError("clock has a jitter with ±, needs a number of seconds")
            drawn.add(name)
        values[name] = _number(name, number.removeprefix(sign), signed=not sign and name != "jitter")
    return ClockSpecification(Clock(**values), frozenset(drawn))


def _number(name: str, text: str, signed: bool) -> float:
    limit = LIMITS[name]
    low = -limit if signed else 0.0
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not low <= value <= limit:
        raise ValueError(f"clock has {name} {text[:40]!r}, needs a number in [{low:g}, {limit:g}] {'ppm' if name == 'drift' else 's'}")
    return value
