"""Bags of a robot as rosbags writes them: ROS 1, ROS 2 (SQLite) and MCAP; a rover on a circle with a panorama, odometry, an IMU and tf_static."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from tracker.formats.ros.bag import filled, message_types
from tracker.formats.ros.messages import Message, header, pose_message, transform, vector
from tracker.geometry import Pose, rotation_z

FORMS = ("ros1", "sqlite3", "mcap")
IMAGE, COMPRESSED, ODOMETRY, IMU = "sensor_msgs/Image", "sensor_msgs/CompressedImage", "nav_msgs/Odometry", "sensor_msgs/Imu"
TF = "tf2_msgs/TFMessage"
EPOCH = 1_700_000_000 * 10**9
WIDTH, HEIGHT = 64, 32
MOUNT = Pose(rotation_z(0.3), np.array([0.1, 0.0, 0.8]))
"""T_base_camera, both x forward."""
OPTICAL = Pose(np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]), np.zeros(3))
Row = tuple[str, str, Message, int]
"""Topic, type, message, and time of the log [ns]."""


def write_bag(path: Path, form: str, rows: Iterable[Row]) -> Path:
    """Write a bag of one of FORMS; returns the file of ROS 1, or the folder of ROS 2."""
    types = get_typestore(Stores.ROS1_NOETIC) if form == "ros1" else message_types()
    if form == "ros1":
        types.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", "tf2_msgs/msg/TFMessage"))
    path = path.with_suffix(".bag") if form == "ros1" else path
    writer = Writer1(path) if form == "ros1" else Writer(path, version=8, storage_plugin=StoragePlugin[form.upper()])
    serialize: Callable[[Any, str], Any] = types.serialize_ros1 if form == "ros1" else types.serialize_cdr
    connections: dict[str, Any] = {}
    with writer:
        for topic, kind, message, log in rows:
            name = kind.replace("/", "/msg/")
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, name, typestore=types)
            writer.write(connections[topic], log, serialize(filled(types, name, message), name))
    return path


def pose_at(seconds: float) -> Pose:
    """T_odom_base of the rover: a circle of 2 m radius at 0.5 m/s, from the origin ahead."""
    angle = 0.25 * seconds
    return Pose.planar(2 * np.sin(angle), 2 - 2 * np.cos(angle), angle, 0.1)


@dataclass(frozen=True, eq=False)
class RobotBag:
    """What the bag holds: images at `rate`, odometry at 20/s, and IMU at 100/s for some seconds. topics left out: `without`.

    change: of a row before it is written; None leaves it out.
    """

    seconds: float = 2.0
    rate: float = 5.0
    without: tuple[str, ...] = ()
    change: Callable[[Row], Row | None] = field(default=lambda row: row)

    def write(self, path: Path, form: str = "mcap") -> Path:
        """Write it."""
        rows = [row for row in sorted(self._rows(), key=lambda row: row[3]) if row[0] not in self.without]
        return write_bag(path, form, [changed for row in rows if (changed := self.change(row)) is not None])

    def _rows(self) -> Iterable[Row]:
        static = [transform("base_link", "camera", MOUNT, EPOCH), transform("camera", "pano_optical", OPTICAL, EPOCH)]
        static.append(transform("base_link", "imu_link", Pose(rotation_z(np.pi / 2), np.zeros(3)), EPOCH))
        yield "/tf_static", TF, {"transforms": static}, EPOCH
        for k in range(int(self.seconds * self.rate) + 1):
            # The camera lies 13 ms between two messages of odometry.
            stamp = EPOCH + round(1e9 * (k / self.rate + 0.013))
            yield "/pano/image_raw", IMAGE, image_message(k, stamp), stamp + 4_000_000
        for k in range(int(self.seconds * 20) + 2):
            stamp = EPOCH + k * 50_000_000
            twist = {"twist": {"linear": vector(np.array([0.5, 0, 0])), "angular": vector(np.array([0, 0, 0.25]))}}
            where = {"header": header(stamp, "odom"), "child_frame_id": "base_link", "twist": twist}
            pose = pose_at(k / 20)
            yield "/odom", ODOMETRY, where | {"pose": {"pose": pose_message(pose)}}, stamp
            yield "/tf", TF, {"transforms": [transform("odom", "base_link", pose, stamp)]}, stamp
        for k in range(int(self.seconds * 100) + 2):
            stamp = EPOCH + k * 10_000_000
            force = {"linear_acceleration": vector(np.array([0.05 * (-1) ** k, 0.1, 9.8]))}
            yield "/imu", IMU, {"header": header(stamp, "imu_link")} | force, stamp


def image_message(k: int, stamp: int, encoding: str = "rgb8") -> Message:
    """An Image whose red grows with k."""
    pixels = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
    pixels[:, :, 0] = 10 * k
    pixels[:, : WIDTH // 2, 1] = 200
    rows = np.pad(pixels.reshape(HEIGHT, -1), ((0, 0), (0, 8)))  # rows may be longer than the image
    size = {"height": HEIGHT, "width": WIDTH, "step": rows.shape[1]}
    return {"header": header(stamp, "pano_optical"), "encoding": encoding, "data": rows.tobytes()} | size


def jpeg_message(k: int, stamp: int) -> Message:
    """A CompressedImage of the same pixels, nearly."""
    pixels = np.frombuffer(image_message(k, stamp)["data"], np.uint8).reshape(HEIGHT, -1)[:, : 3 * WIDTH].reshape(HEIGHT, WIDTH, 3)
    data = cv2.imencode(".jpg", pixels[:, :, ::-1])[1].tobytes()
    return {"header": header(stamp, "pano_optical"), "format": "rgb8; jpeg compressed bgr8", "data": data}
