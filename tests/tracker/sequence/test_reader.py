"""Sequences on disk: round trips, and errors for damaged files."""

import hashlib
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.tracker import sequences
from tracker.geometry import Pose
from tracker.geometry.cameras import Tsai
from tracker.geometry.ground import Grid
from tracker.io.tsai_xml import read_camera
from tracker.sequence.reader import read_sequence
from tracker.sequence.truth_tables import read_boxes, read_joints, read_views
from tracker.sequence.writer import SequenceWriter
from tracker.types import Mount, Setup, Start


def test_round_trip(tmp_path: Path) -> None:
    written = sequences.write(tmp_path / "s")
    read = read_sequence(tmp_path / "s")
    assert read.provenance["scenario"] == {"seed": 0}
    assert len(read.ticks) == len(written)
    for a, b in zip(written, read.ticks, strict=True):
        assert (a.index, a.time) == (b.index, b.time)
        for u, v in zip(a.views, b.views, strict=True):
            assert u.camera == v.camera
            for name in ("bearing", "extent", "confidence", "covariance"):
                np.testing.assert_allclose(getattr(u.detections, name), getattr(v.detections, name), rtol=1e-8, atol=1e-9)
            assert (u.odometry is None) == (v.odometry is None)
            if u.odometry and v.odometry:
                np.testing.assert_allclose(u.odometry.T_before_now.log(), v.odometry.T_before_now.log(), atol=1e-8)
                np.testing.assert_allclose(u.odometry.covariance, v.odometry.covariance)
            assert u.robot_detections is not None
            assert v.robot_detections is not None
            assert u.robot_detections.robot == v.robot_detections.robot
            np.testing.assert_allclose(u.robot_detections.bearing, v.robot_detections.bearing, atol=1e-9)
            np.testing.assert_allclose(u.robot_detections.covariance, v.robot_detections.covariance, rtol=1e-8)
            assert v.image is not None
            assert v.image.shape == (32, 64, 3)
    assert read.truth is not None
    for k, frame in enumerate(read.truth):
        expected = sequences.truth(k)
        np.testing.assert_array_equal(frame.person_id, expected.person_id)
        np.testing.assert_allclose(frame.feet, expected.feet)
        np.testing.assert_allclose(frame.visible, expected.visible)
        assert frame.tipped == expected.tipped
        for robot, pose in expected.T_world_robot.items():
            np.testing.assert_allclose(frame.T_world_robot[robot].log(), pose.log(), atol=1e-8)


def test_setup_round_trip(tmp_path: Path) -> None:
    sequences.write(tmp_path / "s")
    setup, expected = read_sequence(tmp_path / "s").setup, sequences.setup()
    assert list(setup.mounts) == list(expected.mounts)
    assert isinstance(setup.ground, Grid)
    points = np.random.default_rng(0).uniform(-5, 5, (50, 2))
    np.testing.assert_allclose(setup.ground.height_at(points), expected.ground.height_at(points))
    assert setup.occluders is not None
    np.testing.assert_allclose(setup.occluders.height_at(points), expected.ground.height_at(points) + 0.5)
    for name, start in expected.starts.items():
        got = setup.starts[name]
        assert got is not None
        assert start is not None
        np.testing.assert_allclose(got.T_world_robot.log(), start.T_world_robot.log(), atol=1e-9)
        np.testing.assert_allclose(got.covariance, start.covariance)


def test_truth_of_views_round_trip(tmp_path: Path) -> None:
    sequences.write(tmp_path / "s")
    views, boxes, joints = read_views(tmp_path / "s"), read_boxes(tmp_path / "s"), read_joints(tmp_path / "s")
    assert len(views) == len(boxes) == 2 * sequences.FRAMES
    for (frame, camera), view in views.items():
        expected = sequences.view_truth(frame, camera)
        np.testing.assert_allclose(view.T_world_camera.log(), expected.T_world_camera.log(), atol=1e-8)
        np.testing.assert_allclose([view.ground, *view.normal], [expected.ground, *expected.normal], atol=1e-9)
        for name in ("person", "seen", "full", "visible", "range"):
            np.testing.assert_allclose(getattr(view.boxes, name), getattr(expected.boxes, name))
            np.testing.assert_array_equal(getattr(boxes[frame, camera], name), getattr(view.boxes, name))
        np.testing.assert_array_equal(view.keypoints.visibility, expected.keypoints.visibility)
        np.testing.assert_allclose(view.keypoints.pixels, expected.keypoints.pixels, atol=0.0051)
    for frame, (persons, points) in joints.items():
        np.testing.assert_array_equal(persons, [4, 9])
        np.testing.assert_allclose(points, sequences.truth(frame).joints, atol=5.1e-5)


def test_fixed_camera_round_trip_in_both_files(tmp_path: Path) -> None:
    ground = sequences.setup().ground
    assert isinstance(ground, Grid)
    camera = Tsai(768, 576, 5.55, 5.1e-3, 324.2, 282.6, 1.094, 5.127e-3, 4.65e-3)
    pose = Pose.planar(3.0, -2.0, 0.4, 7.0) @ Pose.exp([0, 0, 0, 0.02, 0.3, 0])
    setup = Setup({"View_001": Mount(camera, Pose.identity(), "View_001")}, ground, {"View_001": Start(pose, np.zeros((6, 6)))}, 1 / 7)
    with SequenceWriter(tmp_path / "s", setup, ground) as writer:
        writer.finish({}, {})
    name, of_file, T_world_camera = read_camera(tmp_path / "s" / "calibration" / "View_001.xml")
    assert (name, of_file) == ("View_001", camera)
    np.testing.assert_allclose(T_world_camera.log(), pose.log(), atol=1e-12)
    assert read_sequence(tmp_path / "s").setup.mounts["View_001"].camera == camera


def test_same_input_gives_same_bytes(tmp_path: Path) -> None:
    sequences.write_anew(tmp_path / "a")
    sequences.write_anew(tmp_path / "b")
    sequences.write_anew(tmp_path / "c", seed=1)
    a, b, c = ((tmp_path / name / "manifest.json").read_bytes() for name in "abc")
    assert a == b
    assert a != c


def test_error_leaves_no_folder(tmp_path: Path) -> None:
    tops = sequences.setup().ground
    assert isinstance(tops, Grid)
    with pytest.raises(RuntimeError), SequenceWriter(tmp_path / "s", sequences.setup(), tops):
        raise RuntimeError("the light went out")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("name", "damage", "message"),
    [
        ("manifest.json", b"{", r"manifest.json:1: not JSON"),
        ("manifest.json", None, r"manifest.json: no such file"),
        ("truth/people.csv", None, r"people.csv: missing"),
        ("odometry.csv", b"x", r"odometry.csv: 1 bytes, the manifest says \d+: truncated"),
        ("images/robot_0_camera/000001.jpg", b"", r"000001.jpg: 0 bytes, the manifest says \d+: truncated"),
    ],
)
def test_damaged_file_is_named(tmp_path: Path, name: str, damage: bytes | None, message: str) -> None:
    sequences.write(tmp_path / "s")
    path = tmp_path / "s" / name
    path.unlink() if damage is None else path.write_bytes(damage)
    with pytest.raises(ValueError, match=message):
        read_sequence(tmp_path / "s")


def edit(folder: Path, name: str, change: object) -> None:
    """Change a text file and its entry in the manifest, as somebody who edits by hand would."""
    path, manifest = folder / name, json.loads((folder / "manifest.json").read_text())
    path.write_text(change(path.read_text()))  # type: ignore[operator]
    manifest["files"][name] = {"bytes": path.stat().st_size, "sha256": hashlib.sha256(path.read_bytes()).hexdigest()}
    (folder / "manifest.json").write_text(json.dumps(manifest))


@pytest.mark.parametrize(
    ("name", "old", "new", "message"),
    [
        ("truth/people.csv", "0,9,3,", "0,4,3,", r"people.csv:3: frame 0 has person 4 twice"),
        ("truth/people.csv", "0,9,3,", "0,9,nan,", r"people.csv:3: x is nan, needs a finite number"),
        ("truth/people.csv", "0,9,3,", "0,9,three,", r"people.csv:3: x is 'three', needs a number"),
        ("truth/people.csv", "0,9,3,", "0,9,", r"people.csv:3: 6 values, needs 7"),
        ("truth/people.csv", "frame,person", "frame,who", r"people.csv:1: columns are"),
        ("companions.csv", "0,robot_0_camera,robot_1", "0,robot_0_camera,robot_2", r"companions.csv:2: robot is robot_2, which is not in"),
        ("companions.csv", "0,robot_0_camera,robot_1", "0,robot_0_camera,robot_0", r"companions.csv: frame 0 of robot_0_camera: .* which carries it"),
        ("companions.csv", "1,robot_0_camera", "0,robot_0_camera", r"companions.csv:3: frame 0 has camera robot_0_camera twice"),
        ("companions.csv", ",1e-07,", ",1,", r"companions.csv: frame 0 of robot_0_camera: covariance of robot detection 0 is"),
        ("calibration.json", '"period"', '"pause"', r"calibration.json: field 'period' is missing"),
        ("truth/robots.csv", "\n2,", "\n3,", r"robots.csv: frames are not 0 to 2 without gaps"),
    ],
)
def test_invalid_fields_are_named(tmp_path: Path, name: str, old: str, new: str, message: str) -> None:
    sequences.write(tmp_path / "s")
    assert old in (tmp_path / "s" / name).read_text()
    edit(tmp_path / "s", name, lambda text: text.replace(old, new))
    with pytest.raises(ValueError, match=message):
        read_sequence(tmp_path / "s")


def test_schema_2_has_no_robot_detections(tmp_path: Path) -> None:
    sequences.write(tmp_path / "s")
    manifest = json.loads((tmp_path / "s" / "manifest.json").read_text())
    del manifest["files"]["companions.csv"]
    (tmp_path / "s" / "manifest.json").write_text(json.dumps(manifest))
    (tmp_path / "s" / "companions.csv").unlink()
    assert all(view.robot_detections is None for tick in read_sequence(tmp_path / "s").ticks for view in tick.views)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[]", "schema is None"),
        ("[" * 100_000, "nested too deep|not JSON"),
        ('{"schema": 2, "files": {"a": "b"}}', "entry 'a' has no sha256 and bytes"),
        ('{"schema": 2, "files": {"../../etc/passwd": {"sha256": "", "bytes": 1}}}', "lies outside the folder"),
        ('{"schema": 2, "files": {}}', "does not name README.md"),
    ],
)
def test_malicious_manifests_are_refused(tmp_path: Path, text: str, message: str) -> None:
    sequences.write(tmp_path / "s")
    (tmp_path / "s" / "manifest.json").write_text(text)
    with pytest.raises(ValueError, match=message):
        read_sequence(tmp_path / "s")


def test_more_than_ten_cameras_keep_their_order(tmp_path: Path) -> None:
    mounts = {f"camera_{k}": Mount(sequences.CAMERA, Pose.identity(), f"robot_{k}") for k in range(12)}
    starts = {f"robot_{k}": None for k in range(12)}
    ground = sequences.setup().ground
    assert isinstance(ground, Grid)
    with SequenceWriter(tmp_path / "s", Setup(mounts, ground, {**starts}, 0.1), ground) as writer:
        writer.finish({}, {})
    assert list(read_sequence(tmp_path / "s").setup.mounts) == list(mounts)


def test_who_sits_round_trip(tmp_path: Path) -> None:
    written, tops = sequences.write(tmp_path / "plain"), sequences.setup().ground
    assert isinstance(tops, Grid)
    with SequenceWriter(tmp_path / "s", sequences.setup(), tops) as writer:
        for k, one in enumerate(written):
            instances = {name: np.full((32, 64), 4, np.uint16) for name in sequences.setup().mounts}
            views = {name: sequences.view_truth(k, name) for name in sequences.setup().mounts}
            sequences.add_images(writer, one, instances)
            writer.add(one, replace(sequences.truth(k), sitting=frozenset({9} if k else ())), views)
        writer.finish({}, {})
    truth, plain = read_sequence(tmp_path / "s").truth, read_sequence(tmp_path / "plain").truth
    assert truth is not None
    assert plain is not None
    assert [frame.sitting for frame in truth] == [frozenset({9} if k else ()) for k in range(len(written))]
    assert {frame.sitting for frame in plain} == {None}
    np.testing.assert_array_equal(truth[1].visible, plain[1].visible)
    assert not any("sits" in (tmp_path / "plain" / name).read_text(encoding="utf-8") for name in ("README.md", "truth/people.csv"))
    table = tmp_path / "s" / "truth" / "people.csv"
    table.write_text(table.read_text(encoding="utf-8").replace(",1\n", ",2\n", 1), encoding="utf-8")
    with pytest.raises(ValueError, match=r"people.csv.*(sits is 2|SHA-256|changed)"):
        read_sequence(tmp_path / "s")
    with pytest.raises(ValueError, match=r"sitting is .*needs ids"):
        replace(sequences.truth(0), sitting=frozenset({5}))
