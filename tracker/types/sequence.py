"""A sequence of frames with its setup and, where it is known, the truth; in memory or read from disk as it is iterated."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass, replace
from typing import Any, Protocol

from tracker.types.setup import Mount, Setup
from tracker.types.ticks import Odometry, Tick
from tracker.types.truth import Truth


class Ticks(Protocol):
    """Ticks in order, as often as one likes; odometry: robot → motion, a frame, without looking at images."""

    def __len__(self) -> int: ...

    def __iter__(self) -> Iterator[Tick]: ...

    def odometry(self) -> Iterator[dict[str, Odometry]]: ...


@dataclass(frozen=True, eq=False)
class TicksInMemory:
    """Ticks held in a tuple."""

    ticks: tuple[Tick, ...]
    mounts: dict[str, Mount]

    def __len__(self) -> int:
        return len(self.ticks)

    def __iter__(self) -> Iterator[Tick]:
        return iter(self.ticks)

    def odometry(self) -> Iterator[dict[str, Odometry]]:
        for tick in self.ticks:
            yield {self.mounts[v.camera].robot: v.odometry for v in tick.views if v.odometry is not None}


@dataclass(frozen=True, eq=False)
class Sequence:
    """setup, ticks (one a period), truth (one a tick) or None, provenance: what made it, as JSON values."""

    setup: Setup
    ticks: Ticks
    truth: tuple[Truth, ...] | None
    provenance: dict[str, Any]


def without_starts(sequence: Sequence, robots: Collection[str]) -> Sequence:
    """The sequence where some robots are not told where they start. Raises ValueError for a robot that it does not have, or where no other one
    that moves knows its start.
    """
    starts = sequence.setup.starts
    for robot in robots:
        if robot not in starts:
            raise ValueError(f"{robot!r} is not told its start, needs one of {', '.join(starts)}")
    # A robot that is known exactly is a fixed camera, whose landmarks nobody maps.
    if robots and not set(sequence.setup.anchored_robots) - set(robots):
        raise ValueError("no robot is left that knows its start, needs at least one: the world's frame is theirs")
    if not robots:
        return sequence
    return replace(sequence, setup=replace(sequence.setup, starts={name: None if name in robots else start for name, start in starts.items()}))
