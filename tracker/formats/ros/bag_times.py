"""Stamps of a bag: those that are used, and the frames of a recording that they make."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from tracker.formats.ros.bag_reader import seconds
from tracker.geometry import Ints

Tell = Callable[[str], None]
"""Takes a line for each thing that was assumed or left out."""


@dataclass(eq=False)
class Growing:
    """Stamps of topics that must grow. lost: topic → number of messages left out, and the first of them as text."""

    last: dict[str, int] = field(default_factory=dict)
    taken: dict[str, int] = field(default_factory=dict)
    lost: dict[str, tuple[int, str]] = field(default_factory=dict)

    def take(self, topic: str, stamp: int, log: int) -> bool:
        """Whether a message is used: not where its stamp is 0 though its log is not, or does not grow."""
        unset, last = stamp == 0 and log > 0, self.last.get(topic, -1)
        if not unset and stamp > last:
            self.last[topic], self.taken[topic] = stamp, self.taken.get(topic, 0) + 1
            return True
        why = "stamp is 0" if unset else f"stamp {seconds(stamp)} comes after {seconds(last)}"
        count, first = self.lost.get(topic, (0, f"{why}, at {seconds(log)} s of the log"))
        self.lost[topic] = count + 1, first
        return False

    def tell(self, path: Path, tell: Tell) -> None:
        """Tell what was left out. Raises ValueError for a topic of which nothing is left."""
        for topic, (count, first) in self.lost.items():
            if not self.taken.get(topic):
                raise ValueError(f"{path}: {topic}: {first}; so are all its {count} messages, needs stamps in their headers")
            tell(f"{topic}: left out {count} of {count + self.taken[topic]} messages, the first where {first}")
        self.lost.clear()


@dataclass(frozen=True, eq=False)
class FrameTimes:
    """The times of the frames. zero: time 0 [ns]. rate 1/s. stamps: camera → frame from 0 → stamp [ns] of its image."""

    zero: int
    rate: float
    stamps: dict[str, dict[int, int]]

    @staticmethod
    def of(stamps: Mapping[str, list[int]]) -> FrameTimes:
        """The frames of cameras by the growing stamps of their images, at the rate of the fastest camera."""
        zero = min(of_camera[0] for of_camera in stamps.values())
        rate = max(map(_rate, stamps.values()))
        numbered = {}
        for name, of_camera in stamps.items():
            frame, found = -1, {}
            for stamp in of_camera:
                # Two images that are nearer than half a period have frames of their own; times.csv has their times.
                frame = max(frame + 1, round((stamp - zero) * rate / 1e9))
                found[frame] = stamp
            numbered[name] = found
        return FrameTimes(zero, rate, numbered)

    @property
    def count(self) -> int:
        """Number of frames."""
        return max(max(frames) for frames in self.stamps.values()) + 1

    def nearest(self, stamp: int) -> int | None:
        """The frame at a time [ns] of no camera, None outside the recording."""
        frame = round((stamp - self.zero) * self.rate / 1e9)
        return frame if 0 <= frame < self.count else None

    def of_camera(self, name: str, stamp: int) -> int | None:
        """The frame of a camera whose image is within half a period of a time [ns], else None."""
        stamps, near = self.stamps[name], round((stamp - self.zero) * self.rate / 1e9)
        close = [f for f in range(near - 2, near + 3) if f in stamps and abs(stamps[f] - stamp) <= 5e8 / self.rate]
        return min(close, key=lambda f: abs(stamps[f] - stamp), default=None)

    def of_robot(self, cameras: Iterable[str]) -> Ints:
        """(count,) the time [ns] of each frame for a robot: that of the image of its first camera that has one."""
        out = self.zero + np.round(np.arange(self.count) * 1e9 / self.rate).astype(np.int64)
        for name in reversed(list(cameras)):
            out[list(self.stamps[name])] = list(self.stamps[name].values())
        return out


def _rate(stamps: list[int]) -> float:
    """Images a second, without gaps."""
    intervals = np.diff(stamps)
    usual = intervals[intervals < 1.5 * np.median(intervals)] if len(intervals) else np.array([1e9])
    return round(1e9 / float(usual.mean()), 6)
