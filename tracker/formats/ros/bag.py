"""Writing a bag of ROS 2: an MCAP file with chunks, index and statistics, and the metadata.yaml beside it.

The MCAP format: mcap.dev/spec. Quality of service is written for each topic, so that `ros2 bag play` offers static topics to late subscribers.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, final

from mcap.well_known import MessageEncoding, Profile, SchemaEncoding
from mcap.writer import Writer
from mcap_ros2._dynamic import serialize_dynamic

from tracker.formats.ros.definitions import message_definition
from tracker.io.atomic import write_text

LIBRARY = "pilsim"
"""The library in the file's header. It names no version, so that the same sequence gives the same bytes."""
FOREVER = "{sec: 9223372036, nsec: 854775807}"


@dataclass(frozen=True)
class Topic:
    """A topic: name, type of its messages (package/Name), and whether subscribers that come late get its last message (latched)."""

    name: str
    kind: str
    latched: bool = False

    @property
    def quality(self) -> str:
        """Quality of service as rosbag2 writes it: reliable; transient local where latched, else volatile."""
        durability = 1 if self.latched else 2
        return (
            f"- history: 1\n  depth: 10\n  reliability: 1\n  durability: {durability}\n  deadline: {FOREVER}\n  lifespan: {FOREVER}\n"
            f"  liveliness: 1\n  liveliness_lease_duration: {FOREVER}\n  avoid_ros_namespace_conventions: false"
        )


@final
class BagWriter(AbstractContextManager["BagWriter"]):
    """Writes FOLDER/NAME.mcap and, at the end, FOLDER/metadata.yaml. Messages are mappings of the fields; missing fields are 0 or empty."""

    def __init__(self, folder: Path, name: str) -> None:
        self.folder, self.file = folder, f"{name}.mcap"
        self._stream = (folder / self.file).open("wb")
        self._writer = Writer(self._stream)
        self._writer.start(Profile.ROS2, LIBRARY)
        self._schemas: dict[str, tuple[int, Callable[[Mapping[str, Any]], bytes]]] = {}
        self._channels: dict[Topic, int] = {}
        self._counts: dict[Topic, int] = {}
        self._span: tuple[int, int] | None = None

    def write(self, topic: Topic, message: Mapping[str, Any], stamp: int) -> None:
        """Write a message at a time [ns]."""
        if topic.kind not in self._schemas:
            text, name = message_definition(topic.kind), topic.kind.replace("/", "/msg/")
            number = self._writer.register_schema(name, SchemaEncoding.ROS2, text.encode())
            self._schemas[topic.kind] = number, serialize_dynamic(name, text)[name]
        schema, encode = self._schemas[topic.kind]
        if topic not in self._channels:
            extra = {"offered_qos_profiles": topic.quality}
            self._channels[topic] = self._writer.register_channel(topic.name, MessageEncoding.CDR, schema, extra)
            self._counts[topic] = 0
        self._writer.add_message(self._channels[topic], stamp, encode(message), stamp, self._counts[topic])
        self._counts[topic] += 1
        first, last = self._span or (stamp, stamp)
        self._span = min(first, stamp), max(last, stamp)

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        with self._stream:
            if error is None:
                self._writer.finish()  # type: ignore[no-untyped-call]
        if error is None:
            write_text(self.folder / "metadata.yaml", self._metadata())

    def _metadata(self) -> str:
        """The text of metadata.yaml, version 5 of rosbag2 (Humble), which later releases read."""
        first, last = self._span or (0, 0)
        total = sum(self._counts.values())
        start, length = f"starting_time: {{nanoseconds_since_epoch: {first}}}", f"duration: {{nanoseconds: {last - first}}}"
        lines = [
            "rosbag2_bagfile_information:",
            "  version: 5",
            "  storage_identifier: mcap",
            f"  {start}",
            f"  {length}",
            f"  message_count: {total}",
            "  topics_with_message_count:",
            *(self._topic(topic, count) for topic, count in self._counts.items()),
            '  compression_format: ""',
            '  compression_mode: ""',
            f"  relative_file_paths: [{json.dumps(self.file)}]",
            f"  files:\n    - path: {json.dumps(self.file)}\n      {start}\n      {length}\n      message_count: {total}",
        ]
        return "\n".join(lines) + "\n"

    @staticmethod
    def _topic(topic: Topic, count: int) -> str:
        return (
            f"    - topic_metadata:\n        name: {json.dumps(topic.name)}\n        type: {topic.kind.replace('/', '/msg/')}\n"
            f"        serialization_format: cdr\n        offered_qos_profiles: {json.dumps(topic.quality)}\n      message_count: {count}"
        )
