"""Cameras of recording.json: reading gives back what was written, OpenCV's extrinsics, and one line for each error."""

from __future__ import annotations

import json
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.testing import assert_allclose

from tests.tracker.geometry.random_cameras import MAKERS, image_pixels, random_camera
from tracker.geometry import Pose, exp_so3
from tracker.geometry.cameras import Camera, Cylinder, Fisheye, Panorama, PanoramicCamera, Pinhole, Tsai
from tracker.recordings import RecordingCamera
from tracker.recordings.camera_json import camera_from, camera_to

WHERE = "room/recording.json: cameras.C1"
SQUARE = {"width": 1920, "height": 1080, "R": [[1, 0, 0], [0, 0, -1], [0, 1, 0]], "t": [0.5, 1.5, 4]}
K = [[1100, 0, 965], [0, 1095, 532], [0, 0, 1]]
PINHOLE: dict[str, Any] = {"model": "pinhole", **SQUARE, "K": K, "distortion": [-0.1, 0.02, 0.001, 0.0, 0.0]}
FISHEYE = {"model": "fisheye", **SQUARE, "K": [[500, 0, 960], [0, 500, 540], [0, 0, 1]], "distortion": [0.02, -0.01, 0, 0]}
PANORAMA = {"model": "equirectangular", **SQUARE, "width": 2160}
CYLINDER = {"model": "cylindrical", **SQUARE, "horizon": 210.7, "focal": 481}
TSAI = {"model": "tsai", **SQUARE, "focal": 5.5, "kappa1": 5e-3, "cx": 324, "cy": 282, "sx": 1.09, "dpx": 5e-3, "dpy": 4.65e-3}


def error_of(entry: Any) -> str:
    """The message about an entry; it must be one line that begins with the file and the camera."""
    with pytest.raises(ValueError, match=WHERE) as raised:
        camera_from(json.loads(json.dumps(entry)), WHERE)
    message = str(raised.value)
    assert message.startswith(WHERE)
    assert "\n" not in message
    assert len(message) < 400
    return message[len(WHERE) :]


def assert_same(camera: RecordingCamera, other: RecordingCamera) -> None:
    assert camera.camera == other.camera
    assert camera.robot == other.robot
    assert (camera.own_body is None) == (other.own_body is None)
    if camera.own_body is not None:
        np.testing.assert_array_equal(camera.own_body, other.own_body)
    assert_allclose(camera.pose.rotation, other.pose.rotation, atol=1e-14)
    assert_allclose(camera.pose.translation, other.pose.translation, atol=1e-13)


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("model", MAKERS)
@pytest.mark.parametrize("robot", [None, "r0"])
def test_reading_gives_back_what_was_written(model: str, seed: int, robot: str | None) -> None:
    rng = np.random.default_rng(seed)
    own_body = rng.random((4, 8)) < 0.3 if robot else None
    camera = RecordingCamera(random_camera(model, seed), Pose(exp_so3(rng.normal(0, 2, 3)), rng.normal(0, 10, 3)), robot, own_body=own_body)
    assert_same(camera_from(json.loads(json.dumps(camera_to(camera), allow_nan=False)), WHERE), camera)


@pytest.mark.parametrize(
    ("entry", "kind"),
    [(PINHOLE, Pinhole), (FISHEYE, Fisheye), (PANORAMA, Panorama), (CYLINDER, Cylinder), (TSAI, Tsai)],
)
def test_each_model_is_read(entry: dict[str, Any], kind: type[Camera]) -> None:
    found = camera_from(entry, WHERE)
    assert isinstance(found.camera, kind)
    assert (found.camera.width, found.camera.height) == (entry["width"], entry["height"])
    # The camera looks along y of the world, its z axis; x is to the right in both. It stands at −Rᵀ t.
    assert_allclose(found.pose.rotation, np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1]]))
    assert_allclose(found.pose.translation, [-0.5, -4, 1.5])


def test_world_points_project_as_opencv_has_them() -> None:
    rng = np.random.default_rng(0)
    R, t = exp_so3(rng.normal(0, 1, 3)), rng.normal(0, 3, 3)
    found = camera_from(PINHOLE | {"R": R.tolist(), "t": t.tolist()}, WHERE)
    pixels = image_pixels(found.camera, 0)
    points = found.pose.apply(7 * found.camera.bearings_from_pixels(pixels))
    rvec = np.asarray(cv2.Rodrigues(R)[0])
    projected = cv2.projectPoints(points, rvec, t, np.array(K, dtype=np.float64), np.array(PINHOLE["distortion"]))[0].reshape(-1, 2)
    assert_allclose(projected, pixels, atol=1e-7)


def test_a_lens_without_distortion_may_leave_it_out() -> None:
    for entry in (PINHOLE, FISHEYE):
        camera = camera_from({key: value for key, value in entry.items() if key != "distortion"}, WHERE).camera
        assert isinstance(camera, Pinhole | Fisheye)
        assert not any(camera.distortion)


def test_a_rotation_with_rounded_digits_becomes_the_nearest_rotation() -> None:
    exact = exp_so3([0.3, -1.2, 2.0])
    for digits in (9, 6, 4):
        rotation = camera_from(PINHOLE | {"R": np.round(exact, digits).tolist()}, WHERE).opencv_extrinsics[0]
        assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-14)
        assert_allclose(rotation, exact, atol=10.0**-digits)


@pytest.mark.parametrize(
    ("entry", "text"),
    [
        ([1, 2], ": a JSON list, needs an object"),
        (PINHOLE | {"model": "cylinder"}, ": model is 'cylinder', needs pinhole, fisheye, equirectangular, cylindrical, tsai (is cyl"),
        (PINHOLE | {"model": "opencv"}, "(is pinhole meant?)"),
        (PINHOLE | {"model": None}, ": model is missing, needs pinhole"),
        (PINHOLE | {"width": 1e9}, ": width is 1000000000.0, needs a whole number from 1 to"),
        (PINHOLE | {"height": True}, ": height is True, needs a whole number"),
        (PINHOLE | {"K": [1100, 1095, 965, 532]}, ": K is [1100, 1095, 965, 532], needs 3 x 3 numbers"),
        (PINHOLE | {"K": [[1100, 0], [0, 1095, 1], [0, 0]]}, "needs 3 x 3 numbers"),
        (PINHOLE | {"K": [[1100, 2.5, 965], [0, 1095, 532], [0, 0, 1]]}, ", needs [[fx, 0, cx], [0, fy, cy], [0, 0, 1]] px with fx, fy above 0"),
        (PINHOLE | {"K": [[1100, 0, "965"], [0, 1095, 532], [0, 0, 1]]}, "needs 3 x 3 numbers from -1e+09 to 1e+09"),
        (PINHOLE | {"distortion": [0.1, 0.2, 0, 0]}, ": distortion is [0.1, 0.2, 0, 0], needs 5 numbers from -1e+09 to 1e+09: k1, k2, p1, p2, k3"),
        (PINHOLE | {"distortion": [-0.8, 0, 0, 0, 0]}, "folds within the image: 4"),
        (PINHOLE | {"R": [0.1, 0.2, 0.3]}, ": R is [0.1, 0.2, 0.3], needs 3 x 3 numbers"),
        (PINHOLE | {"R": [[1, 0, 0], [0, 0, 1], [0, 1, 0]]}, ": R is a reflection, det R is -1, needs 1"),
        (PINHOLE | {"R": [[1.1, 0, 0], [0, 0, -1], [0, 1, 0]]}, ": R is no rotation: R Rᵀ differs from 1 by 0.21 and det R is 1.1"),
        (PINHOLE | {"R": [[1e99, 0, 0], [0, 1, 0], [0, 0, 1]]}, "needs 3 x 3 numbers from -1e+09 to 1e+09"),
        (PINHOLE | {"t": [1, 2]}, ": t is [1, 2], needs 3 numbers from -1e+09 to 1e+09: x, y, z in metres"),
        (PINHOLE | {"t": [1, 2, 10**400]}, ": t is [1, 2, 1000"),
        (PINHOLE | {"robot": ""}, ": robot is '', needs the name of a robot"),
        (PINHOLE | {"dist": [0] * 5}, ": field 'dist' is unknown in the model pinhole, needs model, width, height, K, R, t, distortion, robot"),
        (PINHOLE | {"dist": [0] * 5}, "(is distortion meant?)"),
        (PINHOLE | {"no\nsuch\u2028key": 1}, r": field 'no\nsuch\u2028key' is unknown in the model pinhole"),
        (PANORAMA | {"width": 1920}, ": panorama is 1920 x 1080, needs width = 2 height"),
        (TSAI | {"sx": -1}, ": sx is -1.0, needs more than 0"),
        (TSAI | {"sx": 1e-300}, ": sx is 1e-300, needs 0 or at least 1e-12 in size"),
        (FISHEYE | {"distortion": [-0.4, 0, 0, 0]}, ": distortion [-0.4, 0.0, 0.0, 0.0] folds within the image: 304 px from (cx, cy)"),
    ],
)
def test_errors_name_the_field_and_the_bound(entry: Any, text: str) -> None:
    assert text in error_of(entry)


@pytest.mark.parametrize("key", ["model", "width", "K", "R", "t"])
def test_missing_keys_are_named(key: str) -> None:
    assert error_of({name: value for name, value in PINHOLE.items() if name != key}).startswith(f": {key} is missing, ")


def test_a_camera_of_another_class_cannot_be_written() -> None:
    class Other(PanoramicCamera):
        """A panoramic camera that no file knows."""

        def elevations_from_rows(self, rows: Any) -> Any:
            return rows

        def rows_from_elevations(self, elevations: Any) -> Any:
            return elevations

        def pixels_from_bearings(self, bearings: Any) -> Any:
            return bearings

    with pytest.raises(ValueError, match="camera is a Other, needs one of pinhole, fisheye, equirectangular, cylindrical, tsai"):
        camera_to(RecordingCamera(Other(64, 32), Pose.identity()))


def test_a_translation_may_be_a_column_as_opencv_has_it() -> None:
    camera = RecordingCamera.looking_at(Pinhole(640, 480, 500.0, 500.0, 320.0, 240.0), (0, 0, 3), (5, 1, 1))
    entry = camera_to(camera)
    column = entry | {"t": [[one] for one in entry["t"]]}
    assert_allclose(camera_from(column, "C1").pose.translation, camera_from(entry, "C1").pose.translation, rtol=0)
