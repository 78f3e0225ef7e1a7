"""EuRoC export: evo reads the true states; the tables, images and calibrations agree with the sequence."""

import csv
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
from numpy.testing import assert_allclose, assert_array_equal

from tests.tracker.formats.scene import FRAMES, RATE
from tracker.formats.camera_parameters import FACES, ExportedView, face_camera
from tracker.formats.euroc import camera_yaml, velocities
from tracker.formats.exporting import ExportOptions, export
from tracker.geometry import Pose, rotation_from_quaternion
from tracker.geometry.cameras import OPTICAL_FROM_CAMERA, Fisheye, Pinhole
from tracker.sequence.reader import read_sequence
from tracker.sequence.truth_tables import read_views

Exported = Callable[[str], Path]


def matrix(entry: dict[str, list[float]]) -> Pose:
    T = np.array(entry["data"]).reshape(4, 4)
    assert_array_equal(T[3], [0, 0, 0, 1])
    return Pose(T[:3, :3], T[:3, 3])


def test_evo_reads_the_true_states(sequence: Path, exported: Exported) -> None:
    file_interface = pytest.importorskip("evo.tools.file_interface")
    path = exported("euroc") / "plaza" / "robot_0" / "mav0" / "state_groundtruth_estimate0" / "data.csv"
    read = file_interface.read_euroc_csv_trajectory(str(path))
    truth = [t.T_world_robot["robot_0"] for t in read_sequence(sequence).truth or ()]
    assert read.check()[0]
    assert_allclose(read.timestamps, np.arange(FRAMES) / RATE, atol=1e-9)
    assert_allclose(read.positions_xyz, [pose.translation for pose in truth], atol=1e-9)
    for quaternion, pose in zip(read.orientations_quat_wxyz, truth, strict=True):
        assert_allclose(rotation_from_quaternion(quaternion), pose.rotation, atol=1e-9)


def test_images_and_calibration_are_those_of_the_sequence(sequence: Path, exported: Exported) -> None:
    source = read_sequence(sequence)
    folder = exported("euroc") / "plaza" / "robot_0" / "mav0" / "cam0"
    sensor = yaml.safe_load((folder / "sensor.yaml").read_text())
    camera = source.setup.mounts["robot_0_camera"].camera
    assert sensor["resolution"] == [camera.width, camera.height]
    assert sensor["camera_model"] == "equirectangular"
    views = read_views(sequence)
    with (folder / "data.csv").open() as file:
        header, *rows = csv.reader(file)
    assert header == ["#timestamp [ns]", "filename"]
    assert [int(time) for time, _ in rows] == [round(k / RATE * 1e9) for k in range(FRAMES)]
    for k, ((_, name), tick) in enumerate(zip(rows, source.ticks, strict=True)):
        image = cv2.imread(str(folder / "data" / name), cv2.IMREAD_COLOR)
        assert_array_equal(image[:, :, ::-1], next(v.image for v in tick.views if v.camera == "robot_0_camera"))
        T_world_optical = (source.truth or ())[k].T_world_robot["robot_0"] @ matrix(sensor["T_BS"])
        T_world_camera = views[k, "robot_0_camera"].T_world_camera
        assert_allclose(T_world_optical.translation, T_world_camera.translation, atol=1e-6)
        assert_allclose(T_world_optical.rotation, T_world_camera.rotation @ OPTICAL_FROM_CAMERA.T, atol=1e-6)
    fx, fy, cx, cy = sensor["intrinsics"]
    bearing = camera.bearings_from_pixels([[10.5, 20.5]])[0]
    assert_allclose((cx - fx * np.arctan2(bearing[1], bearing[0]), cy - fy * np.arcsin(bearing[2])), (10, 20), atol=1e-9)


def test_faces_and_epoch(sequence: Path, tmp_path: Path) -> None:
    """Where a person's hips lie on a face by its sensor.yaml, they lie in the panorama, too."""
    export(sequence, "euroc", tmp_path / "out", options=ExportOptions(faces=True, epoch=1_700_000_000))
    source = read_sequence(sequence)
    root = tmp_path / "out" / "plaza" / "robot_0" / "mav0"
    camera = source.setup.mounts["robot_0_camera"].camera
    pose = (source.truth or ())[2].T_world_robot["robot_0"]
    points = (source.truth or ())[2].feet + np.array([0, 0, 0.9])
    views = read_views(sequence)
    T_world_camera = views[2, "robot_0_camera"].T_world_camera
    found = 0
    for number, face in enumerate(FACES):
        sensor = yaml.safe_load((root / f"cam{number}" / "sensor.yaml").read_text())
        assert sensor["comment"] == f"robot_0_camera_{face}"
        assert (sensor["camera_model"], sensor["distortion_model"]) == ("pinhole", "radial-tangential")
        side = face_camera(camera).width  # type: ignore[arg-type]
        names = [line.split(",")[1] for line in (root / f"cam{number}" / "data.csv").read_text().splitlines()[1:]]
        assert names[0] == "1700000000000000000.png"
        image = cv2.imread(str(root / f"cam{number}" / "data" / names[2]), cv2.IMREAD_COLOR)
        assert image.shape == (side, side, 3)
        optical = (pose @ matrix(sensor["T_BS"])).inverse().apply(points)
        fx, fy, cx, cy = sensor["intrinsics"]
        u, v = fx * optical[:, 0] / optical[:, 2] + cx, fy * optical[:, 1] / optical[:, 2] + cy
        inside = (optical[:, 2] > 0) & (np.abs(u - cx) < fx) & (np.abs(v - cy) < fy)
        bearings = face_camera(camera).bearings_from_pixels(np.column_stack([u, v])) @ FACES[face].T  # type: ignore[arg-type]
        direct = T_world_camera.inverse().apply(points)
        direct /= np.linalg.norm(direct, axis=1, keepdims=True)
        assert_allclose(bearings[inside], direct[inside], atol=1e-5)
        found += int(inside.sum())
    assert found == len(points) > 0


def test_models_of_lenses() -> None:
    """OpenCV's models keep their numbers; k3 is written where it is not 0."""
    for camera, model, count in [
        (Pinhole(320, 240, 250.0, 251.0, 160.0, 120.0, (-0.1, 0.01, 1e-3, 2e-3, 0.0)), "radial-tangential", 4),
        (Pinhole(320, 240, 250.0, 251.0, 160.0, 120.0, (-0.1, 0.01, 1e-3, 2e-3, 1e-3)), "radial-tangential", 5),
        (Fisheye(320, 240, 150.0, 151.0, 160.0, 120.0, (0.01, 0.0, 0.0, 0.0)), "equidistant", 4),
    ]:
        sensor = yaml.safe_load(camera_yaml(ExportedView("c", "c", camera), Pose.identity(), 6.0))
        assert (sensor["camera_model"], sensor["distortion_model"]) == ("pinhole", model)
        assert sensor["distortion_coefficients"] == list(camera.distortion)[:count]
        assert sensor["intrinsics"] == [camera.fx, camera.fy, camera.cx, camera.cy]


def test_velocities_are_those_of_a_uniform_motion() -> None:
    poses = [Pose.planar(1.5 * k / RATE, -0.5 * k / RATE, 0.0) for k in range(4)]
    assert_allclose(velocities(poses, [round(k / RATE * 1e9) for k in range(4)]), np.tile([1.5, -0.5, 0.0], (4, 1)), atol=1e-6)
    assert_array_equal(velocities(poses[:1], [0]), np.zeros((1, 3)))
