"""AI City track 1: calibration, truth and results read back what was written; every bad field is named with its file."""

import copy
import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from tracker.formats.aicity.files import (
    AiCityObject,
    AiCityRows,
    read_calibration,
    read_ground_truth,
    read_results,
    write_calibration,
    write_ground_truth,
    write_results,
)
from tracker.geometry import exp_so3
from tracker.geometry.cameras import Pinhole
from tracker.recordings import RecordingCamera

LENS = Pinhole(1920, 1080, 1200.5, 1190.0, 960.0, 540.0)
CAMERAS = {f"Camera_{k:02d}": RecordingCamera.of_opencv(LENS, exp_so3([1.9, 0.1 * k, 0.2]), [1.0, 2.0, 8.0 + k]) for k in range(2)}
SENSOR = {
    "type": "camera",
    "id": "Camera",
    "attributes": [{"name": "fps", "value": "30"}, {"name": "frameWidth", "value": 1920}, {"name": "frameHeight", "value": "1080"}],
    "intrinsicMatrix": [[1000, 0, 960], [0, 1000, 540], [0, 0, 1]],
    "extrinsicMatrix": [[1, 0, 0, 0], [0, 0, -1, 3], [0, 1, 0, 5]],
}
OBJECT = {
    "object type": "Person",
    "object id": 3,
    "3d location": [1.0, 2.0, 0.9],
    "3d bounding box scale": [0.5, 0.6, 1.8],
    "3d bounding box rotation": [0.0, 0.0, 1.5],
    "2d bounding box visible": {"Camera": [10, 20, 30, 90]},
}


def changed(value: Any, path: tuple[Any, ...], new: Any) -> Any:
    out = copy.deepcopy(value)
    inner = out
    for key in path[:-1]:
        inner = inner[key]
    inner[path[-1]] = new
    return out


def test_calibration_reads_back_and_projects_as_opencv(tmp_path: Path) -> None:
    path = tmp_path / "calibration.json"
    write_calibration(path, 30.0, CAMERAS)
    points = np.random.default_rng(0).uniform([-3, -3, 0], [3, 3, 2], (20, 3))
    rate, found = read_calibration(path)
    assert (rate, list(found)) == (30.0, list(CAMERAS))
    for (name, written), sensor in zip(CAMERAS.items(), json.loads(path.read_text())["sensors"], strict=True):
        assert found[name].camera == LENS
        R, t = written.opencv_extrinsics
        assert_allclose(found[name].opencv_extrinsics[0], R, atol=1e-12)
        expected = cv2.projectPoints(points, cv2.Rodrigues(R)[0], t, LENS.matrix, np.zeros(5))[0][:, 0]
        homogeneous = np.column_stack([points, np.ones(20)]) @ np.array(sensor["cameraMatrix"]).T
        assert_allclose(homogeneous[:, :2] / homogeneous[:, 2:], expected, rtol=1e-9)
        flat = np.column_stack([points[:, :2], np.ones(20)]) @ np.array(sensor["homography"]).T
        on_ground = cv2.projectPoints(points * [1, 1, 0], cv2.Rodrigues(R)[0], t, LENS.matrix, np.zeros(5))[0][:, 0]
        assert_allclose(flat[:, :2] / flat[:, 2:], on_ground, rtol=1e-9)
        assert_allclose([sensor["coordinates"][axis] for axis in "xyz"], -R.T @ t)


def test_other_sensors_are_left_out_and_numbers_may_be_text(tmp_path: Path) -> None:
    path = tmp_path / "calibration.json"
    # Attributes that are not read hold any text, as in NVIDIA's files.
    polygon = [*SENSOR["attributes"], {"name": "fieldOfViewPolygon", "value": "POLYGON((0 0, 1 0, 1 1, 0 0))"}]
    path.write_text(json.dumps({"sensors": [SENSOR | {"attributes": polygon}, {"type": "lidar", "id": "L"}]}))
    rate, cameras = read_calibration(path)
    assert (rate, list(cameras), cameras["Camera"].camera.width, cameras["Camera"].camera.height) == (30.0, ["Camera"], 1920, 1080)


def test_truth_reads_back(tmp_path: Path) -> None:
    path = tmp_path / "ground_truth.json"
    one = AiCityObject("Person", 7, np.array([1.0, -2.5, 0.875]), np.array([0.6, 0.6, 1.75]), np.array([0.0, 0.0, 2.0]), {"C": np.arange(4.0)})
    other = AiCityObject("Forklift", 7, np.array([4.0, 5.0, 1.0]), np.array([1.0, 2.0, 2.0]), np.zeros(3))
    write_ground_truth(path, {10: [], 2: [one, other]})
    found = read_ground_truth(path)
    assert list(found) == [2, 10]
    for read, written in zip(found[2], (one, other), strict=True):
        assert (read.kind, read.id, list(read.visible)) == (written.kind, written.id, list(written.visible))
        for name in ("centre", "size", "rotation"):
            assert_array_equal(getattr(read, name), getattr(written, name))
    assert_array_equal(found[2][0].visible["C"], np.arange(4.0))


@pytest.mark.parametrize(
    ("path", "new", "message"),
    [
        (("sensors",), None, "sensors is missing"),
        (("sensors",), [], "sensors holds no camera"),
        (("sensors", 0), 3, r"sensors\[0\]: a JSON int, needs an object"),
        (("sensors", 0, "id"), "a/b", r"sensors\[0\]: id is 'a/b', needs a name"),
        (("sensors", 0, "attributes"), {}, r"sensors\[0\]: attributes is dict, needs list"),
        (("sensors", 0, "attributes", 1, "value"), "wide", r"attributes\[1\]: 'wide' is the value of frameWidth, needs a number"),
        (("sensors", 0, "attributes", 1, "value"), 19.5, "attributes: frameWidth is 19.5, needs a whole number"),
        (("sensors", 0, "attributes", 0, "value"), -1, "attributes: fps is -1, needs a number from"),
        (("sensors", 0, "attributes", 0, "name"), "rate", "fps is missing, needs a number"),
        (("sensors", 0, "intrinsicMatrix", 0), [1, 2], "intrinsicMatrix is .*, needs 3 x 3 numbers"),
        (("sensors", 0, "intrinsicMatrix", 0, 0), -5, "with fx, fy above 0"),
        (("sensors", 0, "extrinsicMatrix", 2, 1), 0.9, "extrinsicMatrix is no rotation"),
        (("sensors", 0, "extrinsicMatrix"), None, "extrinsicMatrix is missing, needs 3 x 4 numbers"),
        (("sensors",), [SENSOR, SENSOR], "name 'Camera' twice"),
        (("5",), {}, "frame 5 is a dict, needs a list"),
        (("-1",), [], "frame is '-1', needs each whole number"),
        (("1000000",), [], "from 0 to less than 1000000"),
        (("05",), [], "frame is '05', needs each whole number once"),
        (("5", 0), 1, "frame 5: object 0: a JSON int, needs an object"),
        (("5", 0, "object type"), None, "frame 5: object 0: object type is missing"),
        (("5", 0, "object id"), True, "object id is True, needs a whole number"),
        (("5", 0, "3d location"), [1, 2], "3d location is .*, needs 3 numbers"),
        (("5", 0, "3d location", 0), 1e9, "3d location is .*, needs 3 numbers from -1e"),
        (("5", 0, "3d bounding box scale", 1), 0, "3d bounding box scale is .*, needs 3 numbers from 1e-300"),
        (("5", 0, "2d bounding box visible"), [], "2d bounding box visible: a JSON list"),
        (("5", 0, "2d bounding box visible", "Camera"), [30, 20, 10, 90], "needs the first x and y before the last"),
        (("5",), [OBJECT, OBJECT], "frame 5 holds an object id of a class twice"),
    ],
)
def test_bad_content_is_refused(tmp_path: Path, path: tuple[Any, ...], new: Any, message: str) -> None:
    name, whole, read = ("calibration.json", {"sensors": [SENSOR]}, read_calibration)
    if path[0] != "sensors":
        name, whole, read = ("ground_truth.json", {"5": [OBJECT]}, read_ground_truth)  # type: ignore[dict-item,assignment]
    (tmp_path / name).write_text(json.dumps(changed(whole, path, new)))
    with pytest.raises(ValueError, match=f"{name}: .*{message}"):
        read(tmp_path / name)


def rows() -> AiCityRows:
    rng = np.random.default_rng(0)
    n = 20
    k = np.arange(n)
    return AiCityRows(5 - k // 10, 0 * k, k % 5, k // 5, rng.uniform(-50, 50, (n, 3)), rng.uniform(0.1, 2, (n, 3)), rng.uniform(-3, 3, n))


def test_results_read_back_sorted(tmp_path: Path) -> None:
    path = tmp_path / "track1.txt"
    write_results(path, rows())
    found = read_results(path)
    order = np.lexsort((rows().id, rows().category, rows().frame, rows().scene))
    for name in ("scene", "category", "id", "frame"):
        assert_array_equal(getattr(found, name), getattr(rows(), name)[order])
    assert_allclose(found.boxes, rows().boxes[order], atol=6e-7)
    assert path.read_text().splitlines()[0].split()[:4] == ["4", "0", "0", "2"]
    write_results(path, read_results(path))
    assert_array_equal(read_results(path).boxes, found.boxes)


GOOD = "1 0 7 0 1 2 0.9 0.6 0.6 1.75 0.1"


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("1 0 7 0 1 2 0.9 0.6 0.6 1.75", "10 values, needs 11"),
        ("1 0 7 0.5 1 2 0.9 0.6 0.6 1.75 0", "frame_id is 0.5, needs a whole number"),
        ("1 0 -7 0 1 2 0.9 0.6 0.6 1.75 0", "object_id is -7, needs 0 to less than 9007199254740992"),
        ("1 0 7 1000000 1 2 0.9 0.6 0.6 1.75 0", "frame_id is 1000000, needs 0 to less than 1000000"),
        ("1 0 7 1 x 2 0.9 0.6 0.6 1.75 0", "x is 'x', needs a number"),
        ("1 0 7 1 1 2 0.9 0.6 0 1.75 0", "length is 0.0, needs more than 0"),
        (GOOD, "frame 0 holds id 7 twice"),
    ],
)
def test_bad_results_are_refused_with_their_line(tmp_path: Path, line: str, message: str) -> None:
    path = tmp_path / "track1.txt"
    path.write_text(f"{GOOD}\n\n{line}\n")
    with pytest.raises(ValueError, match=f"track1.txt:3: {message}"):
        read_results(path)
