"""Rerun recordings: complete, readable, and equal to the sequence."""

import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from sim.visualization.rerun_viewer import FRUSTUM, SIGMAS, ellipsoid, lines_of_sight, mesh, show
from tests.tracker import sequences
from tests.tracker.formats import small_sources
from tracker.geometry import Pose, rotation_from_quaternion, rotation_z
from tracker.geometry.cameras import Camera, Cylinder, Fisheye, Panorama
from tracker.geometry.ground import Grid
from tracker.pipeline import track
from tracker.recordings import RecordingCamera
from tracker.recordings.degradation import projected_boxes
from tracker.recordings.folder import write_recording
from tracker.sequence.reader import read_sequence
from tracker.sequence.results import Results, write_results


@pytest.fixture(autouse=True)
def needs_rerun() -> None:
    pytest.importorskip("rerun", reason="needs rerun-sdk")


def chunks(path: Path) -> dict[str, list[Any]]:
    """Entity → its columns as Arrow batches, from the first recording of a file."""
    reader = pytest.importorskip("rerun.chunk", reason="needs rerun-sdk to read recordings").RrdReader(path)
    out: dict[str, list[Any]] = {}
    for chunk in reader.stream():
        out.setdefault(chunk.entity_path, []).append(chunk.to_record_batch())
    return out


def column(batches: list[Any], name: str) -> list[Any]:
    """All rows of the column with this suffix."""
    return [row for batch in batches for field in batch.schema.names if field.endswith(name) for row in batch.column(field).to_pylist()]


def test_a_recording_of_a_sequence_with_its_tracks_or_the_truth_alone(tmp_path: Path) -> None:
    sequences.write(tmp_path / "s" / "sequence")
    show(tmp_path / "s", save=tmp_path / "truth.rrd")
    alone = set(chunks(tmp_path / "truth.rrd"))
    assert "/world/truth/robots/robot_0" in alone
    assert not {"/world/tracks", "/world/robots/robot_0"} & alone
    sequence = read_sequence(tmp_path / "s" / "sequence")
    write_results(tmp_path / "s" / "track", Results.of(track(sequence.setup, sequence.ticks), {}))
    show(tmp_path / "s", save=tmp_path / "out.rrd")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["out.rrd", "s", "truth.rrd"]
    there = chunks(tmp_path / "out.rrd")
    names = {"/world/terrain", "/world/standing", "/world/truth/people", "/world/robots/robot_1", "/world/robots/covariance", "/off/robot_0"}
    assert names | {"/panoramas/robot_0_camera", "/world/tracks"} <= set(there)
    people = there["/world/truth/people"]
    assert sorted(column(people, "frame")) == [0, 1, 2]
    feet = {frame: np.array(rows) for frame, rows in zip(column(people, "frame"), column(people, "Capsules3D:translations"), strict=True)}
    for frame in range(3):
        np.testing.assert_allclose(feet[frame][:, :2], sequences.truth(frame).feet[:, :2], atol=1e-6)
    assert column(people, "Capsules3D:labels")[0] == ["4", "9"]
    (vertices,) = column(there["/world/terrain"], "Mesh3D:vertex_positions")
    ground = sequence.setup.ground
    np.testing.assert_allclose(np.array(vertices)[:, 2], ground.height_at(np.array(vertices)), atol=1e-5)
    (image, *_) = column(there["/panoramas/robot_0_camera"], "EncodedImage:blob")
    assert bytes(np.array(image, dtype=np.uint8).ravel()[:2]) == b"\xff\xd8"


def test_what_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    sequences.write(tmp_path / "s")
    with pytest.raises(ValueError, match=r"needs a name that ends in \.rrd"):
        show(tmp_path / "s", save=tmp_path / "out.mp4")
    with pytest.raises(ValueError, match="exclude each other"):
        show(tmp_path / "s", tmp_path, True, tmp_path / "out.rrd")
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(sys, "platform", "linux")
    with pytest.raises(ValueError, match="no screen here"):
        show(tmp_path / "s")
    with pytest.raises(ValueError, match="nowhere: no such folder"):
        show(tmp_path / "nowhere")
    image = tmp_path / "s" / "images" / "robot_1_camera" / "000002.jpg"
    image.write_bytes(bytes(len(image.read_bytes())))
    with pytest.raises(ValueError, match=r"000002\.jpg: its SHA-256"):
        show(tmp_path / "s", save=tmp_path / "out.rrd")
    assert [path.name for path in tmp_path.iterdir()] == ["s"]


def test_without_rerun_one_line_says_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "rerun", None)
    with pytest.raises(ValueError, match=r'not installed: pip install "pilsim\[view\]"'):
        show(tmp_path)


def test_an_ellipsoid_is_the_covariance() -> None:
    turn = Pose(rotation_z(0.7), np.zeros(3)).rotation
    covariance = turn @ np.diag([0.04, 0.01, 0.0025]) @ turn.T
    half, (x, y, z, w) = ellipsoid(covariance)
    axes = rotation_from_quaternion(np.array([w, x, y, z]))
    np.testing.assert_allclose(axes @ np.diag((half / SIGMAS) ** 2) @ axes.T, covariance, atol=1e-12)
    assert np.linalg.det(axes) == pytest.approx(1.0)


def test_a_mesh_lies_on_the_grid_and_its_normals_point_up() -> None:
    heights = np.random.default_rng(1).normal(size=(7, 5))
    points, triangles, z = mesh(Grid(heights, np.array([-1.0, 2.0]), 0.5))
    np.testing.assert_allclose(points[:, 2], z)
    np.testing.assert_allclose(Grid(heights, np.array([-1.0, 2.0]), 0.5).height_at(points), z)
    assert len(triangles) == 2 * 6 * 4
    a, b, c = (points[triangles[:, k]] for k in range(3))
    assert (np.cross(b - a, c - a)[:, 2] > 0).all()
    large, _, _ = mesh(Grid(np.zeros((1000, 700)), np.zeros(2), 0.1))
    assert len(large) <= 240 * 240


FISHEYE, CYLINDER = Fisheye(400, 400, 130.0, 130.0, 200.0, 200.0), Cylinder(600, 200, 90.0, 100.0)


def test_a_recording_of_ones_own_with_cameras_of_every_kind(tmp_path: Path) -> None:
    scene = small_sources.recording()
    (tmp_path / "r").mkdir()
    more = {"F": RecordingCamera.looking_at(FISHEYE, [4, 8, 3], [4, 3, 0]), "Y": RecordingCamera.looking_at(CYLINDER, [4, 3, 2], [5, 3, 2])}
    write_recording(tmp_path / "r", projected_boxes(replace(scene, cameras={**scene.cameras, **more})))
    for name, shape in (("C1", (720, 1280, 3)), ("F", (400, 400, 3)), ("Y", (200, 600, 3))):
        (tmp_path / "r" / "images" / name).mkdir(parents=True)
        cv2.imwrite(str(tmp_path / "r" / "images" / name / "000001.png"), np.full(shape, 90, np.uint8))
    show(tmp_path / "r", tracked=True, save=tmp_path / "out.rrd")
    there = chunks(tmp_path / "out.rrd")
    assert {"/panoramas/C1", "/panoramas/F", "/panoramas/Y", "/world/tracks", "/world/truth/people"} <= set(there)
    assert "/panoramas/C2" not in there
    # A fixed camera is no robot.
    assert not any(name.startswith(("/world/robots/C", "/off/")) for name in there)
    for name, camera in {**scene.cameras, **more}.items():
        (strips,) = column(there[f"/world/cameras/{name}"], "LineStrips3D:strips")
        away = np.linalg.norm(np.array(strips[0]) - camera.pose.translation, axis=1)
        np.testing.assert_allclose(away, FRUSTUM, atol=1e-5)


def test_frames_after_the_last_labelled_one_have_no_truth(tmp_path: Path) -> None:
    folder = small_sources.write_multiviewx(tmp_path / "m")
    with (folder / "detections" / "C1.txt").open("a") as file:
        file.write("20,-1,600,200,50,150,0.9,-1,-1,-1\n")
    show(folder, tracked=True, save=tmp_path / "out.rrd")
    there = chunks(tmp_path / "out.rrd")
    assert sorted(set(column(there["/world/truth/people"], "frame"))) == list(range(small_sources.FRAMES))
    assert max(column(there["/world/tracks"], "frame")) == 19


@pytest.mark.parametrize("camera", [small_sources.LENS, FISHEYE, CYLINDER, Panorama(64, 32)])
def test_lines_of_sight_are_those_of_the_border(camera: Camera) -> None:
    """They have unit length, and the border of an image that does not wrap projects to its border."""
    border, *lines = lines_of_sight(camera)
    np.testing.assert_allclose(np.linalg.norm(border, axis=1), 1.0)
    np.testing.assert_allclose([line[0] for line in lines if len(line) == 2], 0.0)
    assert sum(len(line) == 2 for line in lines) == (1 if camera.wraps else 4)
    if not camera.wraps:
        from_edge = camera.pixels_from_bearings(border)[0] - (camera.pixel_centre - 0.5)
        beyond = np.minimum(from_edge, np.array([camera.width, camera.height]) - from_edge).min(axis=1)
        np.testing.assert_allclose(beyond, 0.0, atol=1e-3)
