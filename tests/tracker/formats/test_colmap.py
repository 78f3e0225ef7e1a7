"""COLMAP export: pycolmap reads both models; poses, projections and images agree with the sequence."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.testing import assert_allclose

from tests.tracker.formats.scene import FRAMES
from tracker.formats.camera_parameters import FACES, face_camera
from tracker.formats.colmap import colmap_camera
from tracker.geometry import Array
from tracker.geometry.cameras import OPTICAL_FROM_CAMERA, Camera, Fisheye, Panorama, Pinhole
from tracker.sequence.reader import read_sequence
from tracker.sequence.truth_tables import read_joints, read_views

pycolmap = pytest.importorskip("pycolmap")

Exported = Callable[[str], Path]
FIXED = ("view_0", "view_1", "view_2")


@pytest.fixture(scope="module", params=["text", "binary"])
def model(exported: Exported, request: pytest.FixtureRequest) -> Any:
    out = pycolmap.Reconstruction()
    getattr(out, f"read_{request.param}")(str(exported("colmap") / "plaza" / "sparse" / "0"))
    return out


def test_all_views_are_there(exported: Exported, model: Any) -> None:
    names = {f"robot_0_camera_{face}" for face in FACES} | set(FIXED)
    assert {image.name for image in model.images.values()} == {f"{name}/{k:06d}.jpg" for name in names for k in range(FRAMES)}
    assert len(model.cameras) == len(names)
    root = exported("colmap") / "plaza" / "images"
    for image in model.images.values():
        camera = model.cameras[image.camera_id]
        assert cv2.imread(str(root / image.name)).shape == (camera.height, camera.width, 3)


def test_poses_are_the_truth(sequence: Path, model: Any) -> None:
    views = read_views(sequence)
    for image in model.images.values():
        name, frame = image.name.split("/")
        face = name.removeprefix("robot_0_camera_") if name not in FIXED else "front"
        source = "robot_0_camera" if name not in FIXED else name
        if (key := (int(frame[:6]), source)) not in views:
            continue
        truth = views[key].T_world_camera
        assert_allclose(image.projection_center(), truth.translation, atol=1e-6)
        R_optical_world = image.cam_from_world().rotation.matrix()
        assert_allclose(R_optical_world, OPTICAL_FROM_CAMERA @ FACES[face].T @ truth.rotation.T, atol=1e-6)


def test_key_points_project_where_the_truth_has_them(sequence: Path, model: Any) -> None:
    """Visible key points of people, by COLMAP's own projection, lie where keypoints.csv has them, which counts from the corner, too."""
    joints, views = read_joints(sequence), read_views(sequence)
    found = 0
    for image in model.images.values():
        name, frame = image.name.split("/")[0], int(image.name.split("/")[1][:6])
        if name not in FIXED or (frame, name) not in views:
            continue
        keypoints = views[frame, name].keypoints
        for person, pixels, visibility in zip(keypoints.person.tolist(), keypoints.pixels, keypoints.visibility, strict=True):
            ids, places = joints[frame]
            place = places[ids.tolist().index(person)]
            for point, pixel in zip(place[visibility > 0], pixels[visibility > 0], strict=True):
                assert_allclose(image.project_point(point), pixel, atol=0.02)
                found += 1
    assert found > 100


def test_faces_show_the_panorama(sequence: Path, exported: Exported, model: Any) -> None:
    """Pixels of the faces, sent to the panorama by COLMAP's models, have its color."""
    tick = next(iter(read_sequence(sequence).ticks))
    panorama: Array = next(np.asarray(v.image) for v in tick.views if v.camera == "robot_0_camera").astype(np.float32)
    source = read_sequence(sequence).setup.mounts["robot_0_camera"].camera
    smooth = cv2.GaussianBlur(panorama, (0, 0), 2.0)
    for image in model.images.values():
        name, frame = image.name.split("/")
        if name in FIXED or frame != "000000.jpg":
            continue
        face = cv2.imread(str(exported("colmap") / "plaza" / "images" / image.name))[:, :, ::-1].astype(np.float32)
        camera = model.cameras[image.camera_id]
        u, v = np.meshgrid(np.arange(2, camera.width - 2, 5), np.arange(2, camera.height - 2, 5))
        plane = camera.cam_from_img(np.column_stack([u.ravel(), v.ravel()]) + 0.5)
        optical = np.column_stack([plane, np.ones(len(plane))])
        bearing = optical @ OPTICAL_FROM_CAMERA @ FACES[name.removeprefix("robot_0_camera_")].T
        pixels = np.floor(source.pixels_from_bearings(bearing)[0]).astype(int)
        expected = smooth[np.clip(pixels[:, 1], 0, source.height - 1), pixels[:, 0] % source.width]
        shown = cv2.GaussianBlur(face, (0, 0), 2.0)[v.ravel(), u.ravel()]
        assert np.abs(shown - expected).mean() < 6


def test_points_lie_on_the_terrain(sequence: Path, model: Any) -> None:
    points = np.array([point.xyz for point in model.points3D.values()])
    assert 1000 < len(points) <= 20_000
    occluders = read_sequence(sequence).setup.occluders
    assert occluders is not None
    assert_allclose(points[:, 2], occluders.height_at(points), atol=1e-9)


@pytest.mark.parametrize(
    ("camera", "model"),
    [
        (Pinhole(320, 240, 250.0, 251.0, 160.0, 120.0), "PINHOLE"),
        (Pinhole(320, 240, 250.0, 251.0, 160.0, 120.0, (-0.1, 0.01, 1e-3, 2e-3, 0.0)), "OPENCV"),
        (Pinhole(320, 240, 250.0, 251.0, 160.0, 120.0, (-0.1, 0.01, 1e-3, 2e-3, 1e-3)), "FULL_OPENCV"),
        (Fisheye(320, 240, 150.0, 151.0, 160.0, 120.0, (0.01, 0.002, -1e-3, 1e-4)), "OPENCV_FISHEYE"),
        (face_camera(Panorama(512, 256)), "PINHOLE"),
    ],
)
def test_models_project_alike(camera: Camera, model: str) -> None:
    """COLMAP's projection is ours, but for half a pixel."""
    ours = colmap_camera(camera)
    assert ours.model == model
    theirs = pycolmap.Camera(model=ours.model, width=ours.width, height=ours.height, params=list(ours.parameters))
    pixels = np.array([[10.0, 20.0], [160.0, 120.0], [100.5, 30.25]])
    optical = camera.bearings_from_pixels(pixels) @ OPTICAL_FROM_CAMERA.T
    assert_allclose(theirs.img_from_cam(optical), pixels + 0.5, atol=1e-6)


def test_rigs_are_those_of_the_robots(exported: Exported, model: Any) -> None:
    """pycolmap reads the configuration, and places of its cameras in the rig are those of the images of one frame."""
    configurations = pycolmap.read_rig_config(str(exported("colmap") / "plaza" / "rig_config.json"))
    assert [len(rig.cameras) for rig in configurations] == [6, 1, 1, 1]
    by_name = {image.name: image for image in model.images.values()}
    reference, *others = configurations[0].cameras
    assert reference.ref_sensor
    for frame in range(FRAMES):
        first = by_name[f"{reference.image_prefix}{frame:06d}.jpg"].cam_from_world()
        for camera in others:
            expected = by_name[f"{camera.image_prefix}{frame:06d}.jpg"].cam_from_world()
            assert_allclose((camera.cam_from_rig * first).matrix(), expected.matrix(), atol=1e-9)
