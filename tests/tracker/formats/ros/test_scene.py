"""MCAP export: public readers list all topics; images, transforms and truth agree in time and place."""

import subprocess
import sys
from collections import Counter, defaultdict
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from numpy.testing import assert_allclose, assert_array_equal

from tests.tracker.formats.scene import FRAMES, RATE
from tracker.formats.exporting import ExportOptions, export
from tracker.formats.ros.scene import README, ros_names
from tracker.geometry import Array, Pose, rotation_from_quaternion
from tracker.sequence.reader import read_sequence
from tracker.types.sequence import dead_reckoning

Exported = Callable[[str], Path]
CAMERAS = ("robot_0_camera", "view_0", "view_1", "view_2")
EVERY_FRAME = {
    "/tf": "tf2_msgs/msg/TFMessage",
    "/robot_0/odom": "nav_msgs/msg/Odometry",
    "/robot_0/up": "sensor_msgs/msg/Imu",
    "/robot_0/truth/odom": "nav_msgs/msg/Odometry",
    "/robot_0/truth/pose": "geometry_msgs/msg/PoseStamped",
    "/truth/people": "visualization_msgs/msg/MarkerArray",
    **{f"/{camera}/image/compressed": "sensor_msgs/msg/CompressedImage" for camera in CAMERAS},
    **{f"/{camera}/camera_info": "sensor_msgs/msg/CameraInfo" for camera in CAMERAS},
    **{f"/{camera}/detections": "vision_msgs/msg/Detection2DArray" for camera in CAMERAS},
    **{f"/{camera}/truth/detections": "vision_msgs/msg/Detection2DArray" for camera in CAMERAS},
    **{f"/{camera}/{boxes}/markers": "visualization_msgs/msg/ImageMarker" for camera in CAMERAS for boxes in ("detections", "truth/detections")},
}
ONCE = {
    "/tf_static": "tf2_msgs/msg/TFMessage",
    "/robot_0/initialpose": "geometry_msgs/msg/PoseWithCovarianceStamped",
    "/terrain/map": "grid_map_msgs/msg/GridMap",
    "/terrain": "visualization_msgs/msg/Marker",
}


@pytest.fixture(scope="module")
def bag(exported: Exported) -> Path:
    return exported("mcap") / "plaza" / "plaza.mcap"


@pytest.fixture(scope="module")
def messages(bag: Path) -> dict[str, list[tuple[int, Any]]]:
    """Topic → time [ns] and message, by the public decoder."""
    out = defaultdict(list)
    with bag.open("rb") as file:
        for _, channel, message, decoded in make_reader(file, decoder_factories=[DecoderFactory()]).iter_decoded_messages():
            out[channel.topic].append((message.log_time, decoded))
    return dict(out)


@pytest.mark.command
def test_the_script_of_ten_lines_lists_all_topics(bag: Path) -> None:
    """The script of README.md, as it stands there."""
    script = "\n".join(line[4:] for line in README.splitlines() if line.startswith(("    from mcap", "    for message", "        print")))
    assert 3 <= len(script.splitlines()) <= 10
    done = subprocess.run(
        [sys.executable, "-c", script.replace("SEQUENCE.mcap", bag.name)], cwd=bag.parent, capture_output=True, text=True, check=True
    )
    listed = Counter(line.split()[0] for line in done.stdout.splitlines() if line.startswith("/"))
    assert listed == Counter(dict.fromkeys(EVERY_FRAME, FRAMES) | dict.fromkeys(ONCE, 1)) - Counter({"/robot_0/up": 1})


def test_summary_has_statistics_and_an_index(bag: Path) -> None:
    with bag.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        assert sum(1 for _ in reader.iter_messages()) == len(EVERY_FRAME) * FRAMES + len(ONCE) - 1
        summary = reader.get_summary()
        assert reader.get_header().profile == "ros2"
    assert summary is not None
    assert summary.statistics is not None
    kinds = {channel.topic: summary.schemas[channel.schema_id].name for channel in summary.channels.values()}
    assert kinds == EVERY_FRAME | ONCE
    assert summary.statistics.message_count == len(EVERY_FRAME) * FRAMES + len(ONCE) - 1
    assert summary.statistics.message_start_time == 0
    assert summary.statistics.message_end_time == round((FRAMES - 1) / RATE * 1e9)
    assert summary.statistics.chunk_count == len(summary.chunk_indexes) > 0
    assert all(schema.encoding == "ros2msg" and schema.data for schema in summary.schemas.values())


def matrix(transform: Any) -> Pose:
    t, q = transform.translation, transform.rotation
    return Pose(rotation_from_quaternion([q.w, q.x, q.y, q.z]), np.array([t.x, t.y, t.z]))


def frame_of(messages: dict[str, list[tuple[int, Any]]], frame: str, stamp: int) -> Pose:
    """T_world_frame at a time, along the tree of transforms."""
    entries = messages["/tf_static"] + [entry for entry in messages["/tf"] if entry[0] == stamp]
    parents = {t.child_frame_id: t for _, message in entries for t in message.transforms}
    pose = Pose.identity()
    while frame != "world":
        pose, frame = matrix(parents[frame].transform) @ pose, parents[frame].header.frame_id
    return pose


def pixels(info: Any, optical: Array) -> Array:
    """Points (n, 3) in the optical frame → pixels (n, 2), by CameraInfo as README.md has it; NaN behind a pinhole."""
    x, y, z = optical.T
    if info.distortion_model == "equirectangular":
        assert not any(info.k)
        fx, fy, cx, cy = info.d
        return np.column_stack([cx - fx * np.arctan2(-x, z), cy - fy * np.arctan2(-y, np.hypot(x, z))])
    assert info.distortion_model == "plumb_bob"
    out = cv2.projectPoints(optical, np.zeros(3), np.zeros(3), np.reshape(info.k, (3, 3)), np.array(info.d))[0].reshape(-1, 2)
    out[z <= 0] = np.nan
    return np.asarray(out)


def cut_off(centre: Any, size: tuple[float, float], info: Any) -> bool:
    """Whether a box touches the edge of a pinhole's image, where it ends while the body may go on."""
    low, high = (centre.x - size[0] / 2, centre.y - size[1] / 2), (centre.x + size[0] / 2, centre.y + size[1] / 2)
    return min(low) < 1 or high[0] > info.width - 2 or high[1] > info.height - 2


@pytest.mark.parametrize("camera", CAMERAS)
def test_people_lie_in_their_boxes(messages: dict[str, list[tuple[int, Any]]], camera: str) -> None:
    """The cylinder's middle of who is seen whole, through transforms and calibration, lies in the true box of the image of that time."""
    found = 0
    for (stamp, info), (t_image, image), (t_boxes, boxes), (t_people, people) in zip(
        *(messages[f"/{camera}/{topic}"] for topic in ("camera_info", "image/compressed", "truth/detections")), messages["/truth/people"], strict=True
    ):
        assert stamp == t_image == t_boxes == t_people == image.header.stamp.sec * 10**9 + image.header.stamp.nanosec
        assert image.header.frame_id == info.header.frame_id == boxes.header.frame_id
        shape = cv2.imdecode(np.frombuffer(image.data, np.uint8), cv2.IMREAD_COLOR).shape
        assert shape == (info.height, info.width, 3)
        T_optical_world = frame_of(messages, info.header.frame_id, stamp).inverse()
        middle = {m.id: [m.pose.position.x, m.pose.position.y, m.pose.position.z] for m in people.markers if m.ns == "people" and not m.action}
        for detection in boxes.detections:
            if detection.results[0].hypothesis.score < 0.98:
                continue
            u, v = pixels(info, T_optical_world.apply([middle[int(detection.id)]]))[0]
            centre, size = detection.bbox.center.position, (detection.bbox.size_x, detection.bbox.size_y)
            du = u - centre.x
            if info.distortion_model == "equirectangular":
                du = (du + info.width / 2) % info.width - info.width / 2
            elif cut_off(centre, size, info):
                continue
            assert abs(du) <= size[0] / 2
            assert abs(v - centre.y) <= size[1] / 4
            found += 1
    assert found >= FRAMES


@pytest.mark.parametrize("camera", CAMERAS)
def test_lines_on_images_are_the_boxes(messages: dict[str, list[tuple[int, Any]]], camera: str) -> None:
    """Each box has four sides; the lines of one time span the same place as the boxes of that time."""
    for topic in (f"/{camera}/detections", f"/{camera}/truth/detections"):
        for (time, boxes), (_, marker), (_, image) in zip(
            messages[topic], messages[f"{topic}/markers"], messages[f"/{camera}/camera_info"], strict=True
        ):
            assert time == marker.header.stamp.sec * 10**9 + marker.header.stamp.nanosec
            lines = np.array([[p.x, p.y] for p in marker.points]).reshape(-1, 4, 2, 2)
            over = [b.bbox.center.position.x + b.bbox.size_x / 2 > image.width - 0.5 for b in boxes.detections]
            assert len(lines) == len(boxes.detections) + sum(over) * (camera == "robot_0_camera")
            assert len(marker.outline_colors) == len(marker.points)
            spans = [(*box.min(axis=(0, 1)), *box.max(axis=(0, 1))) for box in lines]
            for box in boxes.detections:
                c, w, h = box.bbox.center.position, box.bbox.size_x, box.bbox.size_y
                expected = (c.x - w / 2, c.y - h / 2, c.x + w / 2, c.y + h / 2)
                assert any(np.allclose(span, expected, atol=1e-6) for span in spans)


def test_transforms_and_poses_are_the_truth(sequence: Path, messages: dict[str, list[tuple[int, Any]]]) -> None:
    truth = read_sequence(sequence).truth or ()
    for k, ((stamp, tf), (_, pose), (_, odometry)) in enumerate(
        zip(messages["/tf"], messages["/robot_0/truth/pose"], messages["/robot_0/truth/odom"], strict=True)
    ):
        expected = truth[k].T_world_robot["robot_0"]
        assert stamp == round(k / RATE * 1e9)
        assert [t.child_frame_id for t in tf.transforms] == ["robot_0/base_link"]
        assert_allclose(frame_of(messages, "robot_0/base_link", stamp).translation, expected.translation, atol=1e-12)
        for place in (pose.pose, odometry.pose.pose):
            assert_array_equal([place.position.x, place.position.y, place.position.z], expected.translation)
        if k:
            moved = truth[k - 1].T_world_robot["robot_0"].inverse().apply(expected.translation)
            linear = odometry.twist.twist.linear
            assert_allclose([linear.x, linear.y, linear.z], moved * RATE, atol=1e-9)


def test_odometry_is_dead_reckoning(sequence: Path, messages: dict[str, list[tuple[int, Any]]]) -> None:
    expected = dead_reckoning(read_sequence(sequence))["robot_0"]
    last = -1.0
    for stamp, message in messages["/robot_0/odom"]:
        place, q = message.pose.pose.position, message.pose.pose.orientation
        pose = frame_of(messages, message.header.frame_id, stamp) @ Pose(
            rotation_from_quaternion([q.w, q.x, q.y, q.z]), np.array([place.x, place.y, place.z])
        )
        reckoned = expected[round(stamp * RATE / 1e9)]
        assert reckoned is not None
        assert_allclose((pose.inverse() @ reckoned).log(), 0, atol=1e-9)
        covariance = np.reshape(message.pose.covariance, (6, 6))
        assert_allclose(covariance, covariance.T, atol=1e-15)
        assert np.linalg.eigvalsh(covariance).min() >= -1e-15
        assert np.trace(covariance[:3, :3]) > last
        last = np.trace(covariance[:3, :3])


def test_terrain_is_the_ground(sequence: Path, messages: dict[str, list[tuple[int, Any]]]) -> None:
    [(stamp, marker)] = messages["/terrain"]
    points = np.array([[p.x, p.y, p.z] for p in marker.points])
    ground = read_sequence(sequence).setup.ground
    assert stamp == 0
    assert (marker.type, marker.header.frame_id) == (11, "world")
    assert len(points) % 3 == 0
    assert len(points) == len(marker.colors)
    assert_allclose(points[:, 2], ground.height_at(points), atol=1e-9)
    a, b, c = points.reshape(-1, 3, 3).transpose(1, 0, 2)
    (ux, uy, _), (vx, vy, _) = (b - a).T, (c - a).T
    area = (ux * vy - uy * vx) / 2
    assert (area > 0).all()
    assert_allclose(area.sum(), np.ptp(points[:, 0]) * np.ptp(points[:, 1]))


def test_epoch_moves_all_times(sequence: Path, tmp_path: Path) -> None:
    export(sequence, "mcap", tmp_path / "out", options=ExportOptions(epoch=1_700_000_000))
    with (tmp_path / "out" / "plaza" / "plaza.mcap").open("rb") as file:
        for _, channel, message, decoded in make_reader(file, decoder_factories=[DecoderFactory()]).iter_decoded_messages():
            assert message.log_time >= 1_700_000_000 * 10**9
            if channel.topic == "/view_0/camera_info":
                assert decoded.header.stamp.sec * 10**9 + decoded.header.stamp.nanosec == message.log_time


def test_names_of_ros() -> None:
    assert ros_names(["C 1", "Kamera", "1"]) == {"C 1": "C_1", "Kamera": "Kamera", "1": "n_1"}
    with pytest.raises(ValueError, match="names 'C-1' and 'C 1' are both C_1 in ROS"):
        ros_names(["C 1", "C-1"])
