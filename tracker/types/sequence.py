"""A sequence: its setup, its ticks in memory or on disk, and the ground truth where it is known."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass, replace
from typing import Any, Protocol

from tracker.geometry import Pose
from tracker.types.setup import Mount, Setup
from tracker.types.ticks import Odometry, Tick
from tracker.types.truth import Truth


class Ticks(Protocol):
    """Ticks in order; they can be iterated repeatedly."""

    def __len__(self) -> int: ...

    def __iter__(self) -> Iterator[Tick]: ...

    def odometry(self) -> Iterator[dict[str, Odometry]]:
        """For each tick, robot → odometry. No image is read."""
        ...


@dataclass(frozen=True, eq=False)
class TicksInMemory:
    """Ticks held in a tuple; mounts: camera name → Mount."""

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
    """setup; ticks, one per period; truth, one per tick, or None; provenance: source and parameters of the sequence as JSON values."""

    setup: Setup
    ticks: Ticks
    truth: tuple[Truth, ...] | None
    provenance: dict[str, Any]


def without_starts(sequence: Sequence, robots: Collection[str]) -> Sequence:
    """The sequence with the start poses of `robots` removed.

    Raises ValueError for an unknown robot, and where no moving robot with a known start pose is left.
    """
    starts = sequence.setup.starts
    for robot in robots:
        if robot not in starts:
            raise ValueError(f"robot without a start pose is {robot!r}, needs one of {', '.join(starts)}")
    # Fixed cameras do not count: they map no landmarks, so no other robot can be located relative to them.
    if robots and not set(sequence.setup.anchored_robots) - set(robots):
        raise ValueError("no moving robot with a known start pose is left, needs at least one to define the world frame")
    if not robots:
        return sequence
    return replace(sequence, setup=replace(sequence.setup, starts={name: None if name in robots else start for name, start in starts.items()}))


def dead_reckoning(sequence: Sequence) -> dict[str, list[Pose | None]]:
    """The start poses propagated by odometry alone."""
    poses = {robot: start.T_world_robot for robot, start in sequence.setup.starts.items() if start}
    out: dict[str, list[Pose | None]] = {robot: [] for robot in poses}
    for odometry in sequence.ticks.odometry():
        for robot in poses:
            if robot in odometry:
                poses[robot] = poses[robot] @ odometry[robot].T_before_now
            out[robot].append(poses[robot])
    return out
