"""Stamps of a bag: the choice of usable messages, and the frames of a recording that follow from their stamps."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from tracker.formats.ros.bag_reader import seconds
from tracker.geometry import Ints

Tell = Callable[[str], None]
"""Takes one line of text for each assumption and omission."""


@dataclass(eq=False)
class Growing:
    """Checks that stamps grow in each topic. lost: topic → number of messages left out, and a text about the first of them."""

    last: dict[str, int] = field(default_factory=dict)
    taken: dict[str, int] = field(default_factory=dict)
    lost: dict[str, tuple[int, str]] = field(default_factory=dict)

    def take(self, topic: str, stamp: int, log: int) -> bool:
        """Whether a message is used. It is not if its stamp does not grow, or is 0 while its log time is not."""
        unset, last = stamp == 0 and log > 0, self.last.get(topic, -1)
        if not unset and stamp > last:
            self.last[topic], self.taken[topic] = stamp, self.taken.get(topic, 0) + 1
            return True
        why = "stamp is 0" if unset else f"stamp {seconds(stamp)} comes after {seconds(last)}"
        count, first = self.lost.get(topic, (0, f"{why}, at {seconds(log)} s of the log"))
        self.lost[topic] = count + 1, first
        return False

    def tell(self, path: Path, tell: Tell) -> None:
        """Report the messages left out. Raises ValueError for a topic without a usable message."""
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
        """Number frames at the rate of the fastest camera. stamps: camera → growing stamps [ns] of its images."""
        zero = min(of_camera[0] for of_camera in stamps.values())
        rate = max(map(_rate, stamps.values()))
        numbered = {}
        for name, of_camera in stamps.items():
            frame, found = -1, {}
            for stamp in of_camera:
                # Two images within half a period have separate frames; times.csv has their times.
                frame = max(frame + 1, round((stamp - zero) * rate / 1e9))
                found[frame] = stamp
            numbered[name] = found
        return FrameTimes(zero, rate, numbered)

    @property
    def count(self) -> int:
        """Number of frames."""
        return max(max(frames) for frames in self.stamps.values()) + 1

    def nearest(self, stamp: int) -> int | None:
        """The frame nearest to a time [ns], None outside the recording."""
        frame = round((stamp - self.zero) * self.rate / 1e9)
        return frame if 0 <= frame < self.count else None

    def of_camera(self, name: str, stamp: int) -> int | None:
        """The frame of a camera whose image is within half a period of a time [ns], else None."""
        stamps, near = self.stamps[name], round((stamp - self.zero) * self.rate / 1e9)
        close = [f for f in range(near - 2, near + 3) if f in stamps and abs(stamps[f] - stamp) <= 5e8 / self.rate]
        return min(close, key=lambda f: abs(stamps[f] - stamp), default=None)

    def of_robot(self, cameras: Iterable[str]) -> Ints:
        """Time [ns] of each frame (count,) for a robot: the stamp of the first of `cameras` with an image, else the nominal time."""
        out = self.zero + np.round(np.arange(self.count) * 1e9 / self.rate).astype(np.int64)
        for name in reversed(list(cameras)):
            out[list(self.stamps[name])] = list(self.stamps[name].values())
        return out


def _rate(stamps: list[int]) -> float:
    """Images per second; gaps are left out."""
    intervals = np.diff(stamps)
    usual = intervals[intervals < 1.5 * np.median(intervals)] if len(intervals) else np.array([1e9])
    return round(1e9 / float(usual.mean()), 6)
