"""Exports of IMU, wheel encoders and clocks: EuRoC and MCAP hold the tables of the sequence; sequences without images or robots."""

import hashlib
import json
import shutil
from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from numpy.testing import assert_allclose

from tests.tracker import disc_sequence
from tracker.formats.exporting import ExportOptions, export
from tracker.sequence.robot_sensors import read_imu, read_stamps, read_wheels

EPOCH = 2


@pytest.fixture(scope="module")
def sensed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("sensed") / "disc"
    disc_sequence.write(folder, sensors=disc_sequence.SENSORS)
    return folder


@pytest.fixture(scope="module")
def messages(sensed: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[tuple[int, Any]]]:
    """Topic → log time [ns] and message."""
    out = tmp_path_factory.mktemp("sensed_mcap") / "out"
    export(sensed, "mcap", out, options=ExportOptions(epoch=EPOCH))
    found, last = defaultdict(list), 0
    with (out / "disc" / "disc.mcap").open("rb") as file:
        for _, channel, message, decoded in make_reader(file, decoder_factories=[DecoderFactory()]).iter_decoded_messages(log_time_order=False):
            # The file is in the order of time, so that programs can read it as a stream.
            assert message.log_time >= last - 500
            last = message.log_time
            found[channel.topic].append((message.log_time, decoded))
    return dict(found)


def stamp(message: Any) -> float:
    return message.header.stamp.sec - EPOCH + message.header.stamp.nanosec * 1e-9


def test_samples_are_those_of_the_tables(sensed: Path, messages: dict[str, list[tuple[int, Any]]]) -> None:
    imu, wheels = read_imu(sensed)["robot_0"], read_wheels(sensed)["robot_0"]
    times, found = zip(*messages["/robot_0/imu"], strict=True)
    assert_allclose(np.array(times) * 1e-9 - EPOCH, imu.time, atol=2e-9)
    assert_allclose([stamp(m) for m in found], imu.stamp, atol=2e-9)
    assert_allclose([[m.angular_velocity.x, m.angular_velocity.y, m.angular_velocity.z] for m in found], imu.gyro)
    assert_allclose([[m.linear_acceleration.x, m.linear_acceleration.y, m.linear_acceleration.z] for m in found], imu.force)
    assert_allclose(found[0].angular_velocity_covariance[::4], 198 * 1e-8)
    assert_allclose(found[0].linear_acceleration_covariance[::4], 198 * 4e-6)
    assert found[0].orientation_covariance[0] == -1
    times, found = zip(*messages["/robot_0/wheels"], strict=True)
    assert_allclose(np.array(times) * 1e-9 - EPOCH, wheels.time, atol=2e-9)
    assert_allclose([m.position for m in found], wheels.angle)
    assert found[0].name == ["front_left", "front_right", "rear_left", "rear_right"]


def test_headers_have_the_times_of_the_clocks(sensed: Path, messages: dict[str, list[tuple[int, Any]]]) -> None:
    stamps = read_stamps(sensed)
    for topic, clock in [
        ("/robot_0_camera/image/compressed", "robot_0_camera"),
        ("/View_001/image/compressed", "View_001"),
        ("/View_001/camera_info", "View_001"),
    ]:
        times, found = zip(*messages[topic], strict=True)
        assert_allclose(np.array(times) * 1e-9 - EPOCH, stamps[clock][:, 1], atol=2e-9)
        assert_allclose([stamp(m) for m in found], stamps[clock][:, 2], atol=2e-9)
    assert_allclose([stamp(m) for _, m in messages["/robot_0/odom"]], stamps["robot_0"][:, 2], atol=2e-9)
    assert_allclose([stamp(m) for _, m in messages["/robot_0/truth/pose"]], stamps["robot_0"][:, 1], atol=2e-9)
    static = [t for _, m in messages["/tf_static"] for t in m.transforms]
    assert ("robot_0/base_link", "robot_0/imu") in {(t.header.frame_id, t.child_frame_id) for t in static}


def test_euroc_has_the_imu_and_its_biases(sensed: Path, tmp_path: Path) -> None:
    export(sensed, "euroc", tmp_path / "out", options=ExportOptions(epoch=EPOCH))
    root = tmp_path / "out" / "disc" / "robot_0" / "mav0"
    imu = read_imu(sensed)["robot_0"]
    table = np.loadtxt(root / "imu0" / "data.csv", delimiter=",")
    assert_allclose(table[:, 0] * 1e-9 - EPOCH, imu.stamp, atol=1e-6)
    assert_allclose(table[:, 1:], np.hstack([imu.gyro, imu.force]))
    sensor = yaml.safe_load((root / "imu0" / "sensor.yaml").read_text())
    assert (sensor["rate_hz"], sensor["gyroscope_noise_density"], sensor["accelerometer_noise_density"]) == (198.0, 1e-4, 2e-3)
    states = np.loadtxt(root / "state_groundtruth_estimate0" / "data.csv", delimiter=",")
    assert_allclose(states[1:, 11:], 0.01)
    assert_allclose(states[:, 0] * 1e-9 - EPOCH, np.arange(disc_sequence.FRAMES) / 6, atol=1e-6)
    lines = (root / "cam0" / "data.csv").read_text().splitlines()[1:]
    assert_allclose([int(line.split(",")[0]) * 1e-9 - EPOCH for line in lines], read_stamps(sensed)["robot_0_camera"][:, 2], atol=1e-6)


def test_times_before_0_are_refused_with_advice(sensed: Path, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"disc: the clock of View_001 begins at -1 s, needs --epoch [12] or more"):
        export(sensed, "mcap", tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("form", ["mcap", "euroc", "kitti", "colmap"])
def test_images_that_are_not_there_are_left_out_and_said(tmp_path: Path, form: str) -> None:
    """A sequence that was made without images of the robot."""
    folder = tmp_path / "disc"
    disc_sequence.write(folder)
    shutil.rmtree(folder / "images" / "robot_0_camera")
    manifest = json.loads((folder / "manifest.json").read_text())
    manifest["files"] = {name: entry for name, entry in manifest["files"].items() if not name.startswith("images/robot_0_camera")}
    (folder / "manifest.json").write_text(json.dumps(manifest))
    export(folder, form, tmp_path / "out")
    assert "disc: has no images of robot_0_camera; " in (tmp_path / "out" / "README.md").read_text()
    pictures = [path.relative_to(tmp_path / "out").as_posix() for path in (tmp_path / "out").rglob("*") if path.suffix in (".jpg", ".png")]
    assert not [name for name in pictures if "View_001" not in name]
    assert bool(pictures) == (form == "colmap")


@pytest.mark.parametrize("form", ["euroc", "kitti"])
def test_a_sequence_without_robots_that_move_is_refused(tmp_path: Path, form: str) -> None:
    folder = tmp_path / "disc"
    disc_sequence.write(folder)
    calibration = json.loads((folder / "calibration.json").read_text())
    calibration["starts"]["robot_0"]["covariance"] = np.zeros((6, 6)).tolist()
    text = json.dumps(calibration)
    (folder / "calibration.json").write_text(text)
    manifest = json.loads((folder / "manifest.json").read_text())
    entry = manifest["files"]["calibration.json"]
    entry["sha256"], size = hashlib.sha256(text.encode()).hexdigest(), len(text.encode())
    entry.update({key: size for key in entry if key != "sha256"})
    (folder / "manifest.json").write_text(json.dumps(manifest))
    with pytest.raises(ValueError, match=f"disc: has no robot that moves, which {form} needs"):
        export(folder, form, tmp_path / "out")
