"""Reading a bag with rosbags: ROS 1 (.bag), ROS 2 (a folder with metadata.yaml, .mcap or .db3), and MCAP. Messages are read one by one.

Names of types have no "msg" in the middle: sensor_msgs/Image in ROS 1 and ROS 2 alike.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Iterator
from contextlib import AbstractContextManager
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, final

import numpy as np

from tracker.formats.ros.bag import message_types
from tracker.geometry import Ints

if TYPE_CHECKING:
    from rosbags.interfaces import Connection

SUFFIXES = {".bag": "ROS 1", ".mcap": "MCAP", ".db3": "ROS 2, SQLite"}
METADATA = "metadata.yaml"
LONG = 3.0
"""An interval of more than this many median intervals is a gap."""


def is_bag(path: Path) -> bool:
    """Whether a path is a bag: a file by its suffix, a folder by its metadata.yaml."""
    return path.suffix.lower() in SUFFIXES if path.is_file() else (path / METADATA).is_file()


@final
class BagReader(AbstractContextManager["BagReader"]):
    """An open bag. kinds: topic → type of its messages; counts: topic → number of its messages.

    Raises ValueError where rosbags is not installed, and with the path for a file that is no bag, is damaged or is truncated.
    """

    def __init__(self, path: Path) -> None:
        if not path.exists():
            raise ValueError(f"{path}: no such file or folder")
        if not is_bag(path):
            raise ValueError(f"{path}: is no bag, needs a file .bag, .mcap or .db3, or a folder with {METADATA}")
        types = message_types()
        from rosbags.highlevel import AnyReader

        self.path = path
        try:
            self._reader = AnyReader([path], default_typestore=types)
            self._reader.open()
        except Exception as error:  # damaged files raise errors of many kinds in rosbags
            raise ValueError(f"{path}: cannot be opened as a bag: {_line(error)}; it may be cut (`mcap recover`, `rosbag reindex`)") from None
        self._connections: dict[str, list[Connection]] = defaultdict(list)
        for connection in self._reader.connections:
            self._connections[connection.topic].append(connection)
        self.kinds = {topic: found[0].msgtype.replace("/msg/", "/") for topic, found in self._connections.items()}
        self.counts = {topic: sum(c.msgcount for c in self._connections[topic]) for topic in self.kinds}

    def of_kind(self, *kinds: str) -> list[str]:
        """The topics of the given types, in the order of the bag."""
        return [topic for topic, kind in self.kinds.items() if kind in kinds]

    def raw(self, topics: Collection[str]) -> Iterator[tuple[Connection, int, bytes]]:
        """Messages of the given topics in the order of the log: connection, time of the log [ns], and bytes.

        Raises ValueError with the last topic and time where the bag is damaged or truncated.
        """
        if not (chosen := [connection for topic in topics for connection in self._connections[topic]]):
            return
        last = "its beginning"
        messages = self._reader.messages(chosen)
        while True:
            try:
                connection, time, raw = next(messages)
            except StopIteration:
                return
            except Exception as error:  # as above
                raise ValueError(f"{self.path}: is damaged or cut after {last}: {_line(error)}") from None
            yield connection, time, raw
            last = f"{connection.topic} at {seconds(time)} s"

    def messages(self, topics: Collection[str]) -> Iterator[tuple[str, int, Any]]:
        """Topic, time of the log [ns] and message, as `raw`. Also raises ValueError for bytes that are no message of the topic's type."""
        for connection, time, raw in self.raw(topics):
            try:
                message = self._reader.deserialize(raw, connection.msgtype)
            except Exception as error:  # as above
                raise ValueError(f"{self.path}: {connection.topic} at {seconds(time)} s cannot be read: {_line(error)}") from None
            yield connection.topic, time, message

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self._reader.close()


def seconds(stamp: int) -> str:
    """Nanoseconds as seconds with all digits."""
    return f"{stamp // 10**9}.{stamp % 10**9:09d}"


def _line(error: Exception) -> str:
    return " ".join(str(error).split())[:160] or type(error).__name__


def summarize_bag(path: Path) -> dict[str, Any]:
    """Topics of a bag as JSON values: type, number of messages, rate [1/s] and gaps from log times. Raises ValueError as BagReader."""
    times: dict[str, list[int]] = defaultdict(list)
    with BagReader(path) as bag:
        for connection, time, _ in bag.raw(bag.kinds):
            times[connection.topic].append(time)
        kinds = dict(bag.kinds)
    first, last = min((t[0] for t in times.values()), default=0), max((t[-1] for t in times.values()), default=0)
    topics = {topic: {"type": kind, "messages": len(times[topic])} | _pace(np.array(times[topic])) for topic, kind in sorted(kinds.items())}
    form = SUFFIXES.get(path.suffix.lower(), "ROS 2")
    return {"bag": str(path), "format": form, "start": seconds(first), "seconds": (last - first) / 1e9, "topics": topics}


def _pace(times: Ints) -> dict[str, Any]:
    """rate: 1 over the median interval. gaps: number of intervals that are more than LONG medians; longest_gap s."""
    intervals = np.diff(times)
    if not (len(intervals) and (median := float(np.median(intervals))) > 0):
        return {"rate": None, "gaps": 0, "longest_gap": None}
    long = intervals[intervals > LONG * median]
    return {"rate": round(1e9 / median, 3), "gaps": len(long), "longest_gap": float(long.max()) / 1e9 if len(long) else None}


def bag_text(summary: dict[str, Any]) -> str:
    """The result of summarize_bag as text: a line for the bag and one for each topic."""
    count = sum(row["messages"] for row in summary["topics"].values())
    lines = [f"{summary['bag']}: {summary['format']}, {count} messages in {summary['seconds']:.3f} s from {summary['start']}"]
    for topic, row in summary["topics"].items():
        rate = "" if row["rate"] is None else f", {row['rate']:g}/s"
        gaps = f", {row['gaps']} gap{'s' * (row['gaps'] != 1)} up to {row['longest_gap']:.3f} s" if row["gaps"] else ""
        lines.append(f"  {topic}: {row['type']}, {row['messages']}{rate}{gaps}")
    return "\n".join(lines)
