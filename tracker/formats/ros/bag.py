"""Writing a bag of ROS 2 with rosbags: an MCAP file with chunks, index and statistics, and the metadata.yaml beside it.

Quality of service is written for each topic, so that `ros2 bag play` offers static topics to late subscribers.
rosbags knows the messages of ROS 2 Humble; those of vision_msgs 4 and grid_map_msgs are defined here. Later releases have the same fields.
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, final

import numpy as np

if TYPE_CHECKING:
    from rosbags.interfaces import Connection, Qos
    from rosbags.typesys.store import Typestore

DEFINITIONS = {
    "vision_msgs/msg/Point2D": "float64 x\nfloat64 y",
    "vision_msgs/msg/Pose2D": "vision_msgs/Point2D position\nfloat64 theta",
    "vision_msgs/msg/BoundingBox2D": "vision_msgs/Pose2D center\nfloat64 size_x\nfloat64 size_y",
    "vision_msgs/msg/ObjectHypothesis": "string class_id\nfloat64 score",
    "vision_msgs/msg/ObjectHypothesisWithPose": "vision_msgs/ObjectHypothesis hypothesis\ngeometry_msgs/PoseWithCovariance pose",
    "vision_msgs/msg/Detection2D": "std_msgs/Header header\nvision_msgs/ObjectHypothesisWithPose[] results\n"
    "vision_msgs/BoundingBox2D bbox\nstring id",
    "vision_msgs/msg/Detection2DArray": "std_msgs/Header header\nvision_msgs/Detection2D[] detections",
    "grid_map_msgs/msg/GridMapInfo": "float64 resolution\nfloat64 length_x\nfloat64 length_y\ngeometry_msgs/Pose pose",
    "grid_map_msgs/msg/GridMap": "std_msgs/Header header\ngrid_map_msgs/GridMapInfo info\nstring[] layers\nstring[] basic_layers\n"
    "std_msgs/Float32MultiArray[] data\nuint16 outer_start_index\nuint16 inner_start_index",
}
"""Type → its fields, one per line, as in a .msg file."""
QUATERNION = "geometry_msgs/msg/Quaternion"
NUMBERS = {"bool": False, "string": ""}
"""Basic type → the value of a field that a message leaves out; 0 for all other types."""
DEPTH = 10


@dataclass(frozen=True)
class Topic:
    """A topic: name, type of its messages (package/Name), and whether late subscribers get its last message (latched)."""

    name: str
    kind: str
    latched: bool = False

    @property
    def quality(self) -> Qos:
        """Quality of service: reliable; transient local where latched, else volatile."""
        from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime

        forever = QosTime(9223372036, 854775807)
        durability = QosDurability.TRANSIENT_LOCAL if self.latched else QosDurability.VOLATILE
        liveliness = QosLiveliness.AUTOMATIC
        return Qos(QosHistory.KEEP_LAST, DEPTH, QosReliability.RELIABLE, durability, forever, forever, liveliness, forever, False)


@final
class BagWriter(AbstractContextManager["BagWriter"]):
    """Writes FOLDER/NAME.mcap, and at the end FOLDER/metadata.yaml. NAME is the name of the folder, which must not exist yet.

    Messages are mappings of the fields; missing fields are 0, empty, or no rotation. Raises ValueError where rosbags is not installed.
    """

    def __init__(self, folder: Path) -> None:
        self._types = message_types()
        from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer

        # The version of ROS 2 Iron, which later releases read.
        self._writer = Writer(folder, version=8, storage_plugin=StoragePlugin.MCAP)
        self._writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
        self._writer.open()
        self._connections: dict[Topic, Connection] = {}

    def write(self, topic: Topic, message: Mapping[str, Any], stamp: int) -> None:
        """Write a message at a time [ns]."""
        kind = topic.kind.replace("/", "/msg/")
        if topic not in self._connections:
            self._connections[topic] = self._writer.add_connection(topic.name, kind, typestore=self._types, offered_qos_profiles=[topic.quality])
        self._writer.write(self._connections[topic], stamp, self._types.serialize_cdr(filled(self._types, kind, message), kind))

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self._writer.__exit__(kind, error, trace)


@cache
def message_types() -> Typestore:
    """The types of ROS 2 Humble and DEFINITIONS. Raises ValueError where rosbags is not installed."""
    try:
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore
    except ImportError:
        raise ValueError("bags need rosbags: pip install 'pilsim[ros]'") from None
    store = get_typestore(Stores.ROS2_HUMBLE)
    for name, text in DEFINITIONS.items():
        store.register(get_types_from_msg(text, name))
    return store


def filled(types: Typestore, kind: str, message: Mapping[str, Any]) -> Any:
    """The message of a type (package/msg/Name) with all its fields. Raises ValueError for a field that the type does not have."""
    _, fields = types.fielddefs[kind]
    if unknown := message.keys() - {name for name, _ in fields}:
        raise ValueError(f"message {kind} has {sorted(unknown)}, needs fields of it")
    if kind == QUATERNION:
        message = {"w": 1.0, **message}
    return types.types[kind](**{name: _value(types, form, message.get(name)) for name, form in fields})


def _value(types: Typestore, form: Any, value: Any) -> Any:
    """The value of a field. form: node type and its details, as rosbags describes types. value: None for a field that is left out."""
    from rosbags.interfaces import Nodetype

    node, detail = form
    if node == Nodetype.BASE:
        return NUMBERS.get(detail[0], 0) if value is None else value
    if node == Nodetype.NAME:
        return filled(types, detail, value or {})
    (inner, element), length = detail
    if inner == Nodetype.BASE and element[0] != "string":
        if isinstance(value, bytes):
            return np.frombuffer(value, np.uint8)
        return np.zeros(length if node == Nodetype.ARRAY else 0, element[0]) if value is None else np.asarray(value, element[0])
    return [_value(types, (inner, element), entry) for entry in value or ()]
