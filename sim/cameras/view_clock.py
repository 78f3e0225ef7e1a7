"""When fixed cameras take their pictures: a rate and an offset of their own, lost pictures, and freezes."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

LIMITS: dict[str, tuple[float, float]] = {"rate": (0.1, 60.0), "offset": (0.0, 60.0), "lost": (0.0, 0.95)}
"""Least and greatest rate 1/s, offset s, and probability of a loss."""
LONGEST = 1e5
"""s: largest begin, and largest length, of a freeze."""
_GRAMMAR = "[NAME:]rate=HZ,offset=S,lost=P,freeze=BEGIN+SECONDS, more cameras after ;"


class TimedPicture(NamedTuple):
    """A picture of a camera: its number from 0, the time s at which it is taken, and whether it arrives."""

    number: int
    time: float
    arrives: bool


@dataclass(frozen=True)
class ViewClock:
    """Picture k is taken at offset + k / rate s; 0 for the rate of the scenario. It is lost with the probability `lost`.

    freezes: begin and length s of spans without pictures.
    """

    rate: float = 0.0
    offset: float = 0.0
    lost: float = 0.0
    freezes: tuple[tuple[float, float], ...] = ()

    def pictures(self, end: float, rate: float, rng: np.random.Generator) -> list[TimedPicture]:
        """The pictures up to `end` s. rate: of the scenario."""
        step = 1 / (self.rate or rate)
        times = self.offset + step * np.arange(max(0, math.floor((end - self.offset) / step + 1e-9) + 1))
        arrives = rng.random(len(times)) >= self.lost
        for begin, length in self.freezes:
            arrives &= ~((times >= begin) & (times < begin + length))
        return [TimedPicture(k, float(time), bool(arrives[k])) for k, time in enumerate(times)]


def parse_view_clocks(text: str, rate: float) -> dict[str, ViewClock]:
    """Name of a fixed camera → its clock; the name "" stands for all others. rate: of the scenario, frames/s.

    Example: View_002:rate=7,offset=0.13;View_003:lost=0.1;View_004:freeze=4+3. A camera may freeze several times.
    Raises ValueError for another text, a name that occurs twice, a value out of LIMITS, and a rate above that of the scenario.
    """
    found: dict[str, ViewClock] = {}
    for part in text.split(";"):
        name, colon, values = part.strip().rpartition(":")
        if colon and not re.fullmatch(r"\w+", name):
            raise ValueError(f"view_clock has the name {name[:60]!r}, needs {_GRAMMAR}")
        if name in found:
            raise ValueError(f"view_clock names {name or 'all cameras'} twice")
        clock = ViewClock()
        for item in values.split(","):
            clock = _with(clock, item.strip())
        if clock.rate > rate:
            raise ValueError(f"view_clock has rate {clock.rate:g}, needs at most {rate:g} frames/s, the rate of the scenario")
        found[name] = clock
    return found


def _with(clock: ViewClock, item: str) -> ViewClock:
    name, equals, number = (part.strip() for part in item.partition("="))
    if not equals or name not in (*LIMITS, "freeze"):
        raise ValueError(f"view_clock has {item[:60]!r}, needs {_GRAMMAR}")
    if name == "freeze":
        begin, plus, length = number.partition("+")
        span = _number(begin), _number(length)
        if not plus or not (0 <= span[0] <= LONGEST and 0 < span[1] <= LONGEST):
            raise ValueError(f"view_clock has freeze {number[:40]!r}, needs BEGIN+SECONDS")
        return replace(clock, freezes=(*clock.freezes, span))
    low, high = LIMITS[name]
    if not low <= _number(number) <= high:
        raise ValueError(f"view_clock has {name} {number[:40]!r}, needs a number in [{low:g}, {high:g}]")
    return ViewClock(**(vars(clock) | {name: _number(number)}))


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return math.nan
