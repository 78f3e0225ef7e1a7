"""WILDTRACK and MultiviewX as recordings: which data set a folder is, frames and places, real cameras, and invalid content."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from tracker.formats.wildtrack.files import GroundGrid, WildtrackPosition, opencv_camera, write_calibration, write_config, write_positions
from tracker.formats.wildtrack.reading import WILDTRACK_CAMERAS, is_wildtrack, read_wildtrack
from tracker.geometry import Pose
from tracker.geometry.cameras import pinhole
from tracker.io.mot15 import Mot15Rows, write_mot15
from tracker.metrics.evaluation import evaluate
from tracker.options import parameters_from
from tracker.pipeline import track
from tracker.recordings.degradation import BoxNoise, projected_boxes
from tracker.sequence.results import Results

Data = Callable[..., Path]
CORNERS = ((0.0, 0.0, 0.6), (25.0, 16.0, 0.6 + np.pi))
"""x, y m and heading rad of two cameras 4 m above the grid of MultiviewX."""


def multiviewx(folder: Path, positions: tuple[int, ...] = (0, 12_345, 639_999), frames: int = 2) -> Path:
    """A folder laid out as MultiviewX: two cameras, and people who stand on `positions`, without `views`."""
    for number, (x, y, heading) in enumerate(CORNERS, 1):
        camera, _ = opencv_camera(pinhole(1920, 1080, 1.4), Pose.planar(x, y, heading, 4.0))
        write_calibration(folder / "calibrations", f"Camera{number}", camera)
    (folder / "annotations_positions").mkdir()
    for frame in range(frames):
        people = [WildtrackPosition(10 + k, position, np.zeros((0, 4), dtype=np.int64)) for k, position in enumerate(positions)]
        write_positions(folder / "annotations_positions" / f"{frame:05d}.json", people)
    return folder


def test_multiviewx_is_told_by_its_cameras(tmp_path: Path) -> None:
    recording = read_wildtrack(multiviewx(tmp_path))
    assert is_wildtrack(tmp_path)
    assert (recording.rate, recording.frames, list(recording.cameras), recording.source["source"]) == (2.0, 2, ["C1", "C2"], "MultiviewX")
    assert_array_equal(recording.area, [[0, 0], [25, 16]])
    ids, places = (recording.truth or {})[1]
    assert ids.tolist() == [10, 11, 12]
    # positionID = gx + 1000 gy: 12 345 is gx = 345, gy = 12.
    assert_allclose(places, [[0, 0, 0], [8.625, 0.3, 0], [24.975, 15.975, 0]])
    for (x, y, heading), camera in zip(CORNERS, recording.cameras.values(), strict=True):
        expected = Pose.planar(x, y, heading, 4.0)
        assert_allclose(camera.pose.rotation, expected.rotation, atol=1e-12)
        assert_allclose(camera.pose.translation, expected.translation, atol=1e-12)
    # Nobody detected anybody: the source opens and can be scored.
    assert recording.detections == {}
    assert len(recording.sequence().truth or ()) == 2


def test_a_grid_of_config_json_and_its_rate(tmp_path: Path) -> None:
    multiviewx(tmp_path, positions=(3 + 40 * 2,))
    write_config(tmp_path / "config.json", GroundGrid(np.array([10.0, 5.0]), 40, 30, 0.1), 2, 2, (1080, 1920), rate=4.0)
    recording = read_wildtrack(tmp_path)
    assert recording.rate == 4.0
    assert_allclose(recording.area, [[10, 5], [14, 8]])
    assert_allclose((recording.truth or {})[0][1], [[10.3, 5.2, 0]])
    write_config(tmp_path / "config.json", GroundGrid(np.zeros(2), 40, 30, 0.1), 2, 2, (1080, 1920))
    with pytest.raises(ValueError, match=r"config\.json: rate is missing, needs a number .*annotated frames per second"):
        read_wildtrack(tmp_path)


def test_wildtrack_as_distributed(data: Data) -> None:
    recording = read_wildtrack(data("wildtrack"))
    assert (recording.rate, recording.frames, len(recording.cameras)) == (2.0, 360, 7)
    assert recording.source["intrinsics"] == "intrinsic_zero"
    ids, places = (recording.truth or {})[0]
    # The first entry of 00000000.json: personID 0 at positionID 363515 = 155 + 480 · 757.
    assert ids[0] == 0
    assert_allclose(places[0], [-3 + 0.025 * 155, -9 + 0.025 * 757, 0])
    # Frame k (from 1) is file 5 (k - 1).
    last = json.loads((data("wildtrack") / "annotations_positions" / "00001795.json").read_text())
    assert sorted(one["personID"] for one in last) == sorted((recording.truth or {})[359][0].tolist())
    # OpenCV projects with the files' own numbers, in centimetres, onto the same pixels.
    for name, stem in zip(recording.cameras, WILDTRACK_CAMERAS, strict=True):
        text = (data("wildtrack") / "calibrations" / "extrinsic" / f"extr_{stem}.xml").read_text()
        rvec, tvec = (np.array(text.split(f"<{tag}>")[1].split("<")[0].split(), dtype=float) for tag in ("rvec", "tvec"))
        camera = recording.cameras[name]
        pixels, seen = camera.camera.pixels_from_bearings(camera.pose.inverse().apply(places))
        expected = cv2.projectPoints(100 * places, rvec, tvec, camera.camera.matrix, np.zeros(5))[0].reshape(-1, 2)  # type: ignore[attr-defined]
        assert seen.any()
        assert_allclose(pixels[seen], expected[seen], atol=1e-6)


def test_feet_of_a_real_detector_are_near_the_truth(data: Data) -> None:
    """FairMOT in view 5: the median distance to the nearest true person is 0.3 m; with another unit, order of cameras or frames it is metres."""
    recording = read_wildtrack(data("wildtrack")).choose(["C5"])
    camera, distances = recording.cameras["C5"], []
    for frame, (boxes, confidence) in recording.detections["C5"].items():
        feet = np.column_stack([boxes[:, 0] + boxes[:, 2] / 2, boxes[:, 1] + boxes[:, 3]])[confidence > 0.5]
        rays = camera.camera.bearings_from_pixels(feet) @ camera.pose.rotation.T
        places = (camera.pose.translation - rays * camera.pose.translation[2] / rays[:, 2:])[rays[:, 2] < 0]
        true = (recording.truth or {})[frame][1] if frame in (recording.truth or {}) else np.zeros((0, 3))
        if len(places) and len(true):
            distances += np.linalg.norm(places[:, None, :2] - true[None, :, :2], axis=2).min(axis=1).tolist()
    assert len(distances) > 1000
    assert np.median(distances) < 0.5


@pytest.mark.soak
def test_real_crowd_with_projected_boxes(data: Data) -> None:
    """Frames 1 to 180 (those for tuning), bodies of 1.75 x 0.5 m, misses 0.1, edges 2 %, seed 0."""
    recording = projected_boxes(read_wildtrack(data("wildtrack")), BoxNoise(0.1, 0.02), seed=0).cut(0, 180)
    sequence = recording.sequence()
    estimates = track(sequence.setup, sequence.ticks, parameters_from({"delay": 5}))
    scores = evaluate(sequence, Results.of(estimates, run={}))["targets"]
    assert scores["mota"] > 0.8
    assert scores["idf1"] > 0.8


def edited(folder: Path, name: str, old: str, new: str) -> None:
    text = (folder / name).read_text()
    assert old in text
    (folder / name).write_text(text.replace(old, new, 1))


def centimetres(folder: Path) -> None:
    for number, (x, y, heading) in enumerate(CORNERS, 1):
        camera, _ = opencv_camera(pinhole(1920, 1080, 1.4), Pose.planar(x, y, heading, 4.0))
        scaled = replace(camera, pose=Pose(camera.pose.rotation, 100 * camera.pose.translation))
        write_calibration(folder / "calibrations", f"Camera{number}", scaled)


def looking_away(folder: Path) -> None:
    for number, (x, y, heading) in enumerate(CORNERS, 1):
        camera, _ = opencv_camera(pinhole(1920, 1080, 1.4), Pose.planar(x, y, heading + np.pi, 4.0))
        write_calibration(folder / "calibrations", f"Camera{number}", camera)


def detections_of(name: str) -> Callable[[Path], None]:
    def write(folder: Path) -> None:
        (folder / "detections").mkdir()
        rows = Mot15Rows(np.array([1]), np.array([-1]), np.array([[1.0, 2, 30, 40]]), np.array([0.9]), np.full((1, 3), -1.0))
        write_mot15(folder / "detections" / f"{name}.txt", rows)

    return write


POSITIONS = "annotations_positions/00001.json"
FAULTS: dict[str, tuple[Callable[[Path], object], str]] = {
    "beyond the grid": (
        lambda f: edited(f, POSITIONS, "639999", "640000"),
        r"00001\.json: person 12: positionID is 640000, needs 0 to 639999, a point of the grid of 1000 x 640",
    ),
    "below the grid": (lambda f: edited(f, POSITIONS, ": 12345", ": -1"), r"person 11: positionID is -1, needs 0 to 639999"),
    "half a cell": (lambda f: edited(f, POSITIONS, "12345", "12345.5"), r"positionID is 12345\.5, needs a whole number"),
    "one person twice": (lambda f: edited(f, POSITIONS, '"personID": 11', '"personID": 10'), r"00001\.json: personID 10 occurs twice"),
    "a name that is no number": (
        lambda f: shutil.copy(f / POSITIONS, f / "annotations_positions" / "last.json"),
        r"last\.json: its name is no number",
    ),
    "a frame twice": (lambda f: shutil.copy(f / POSITIONS, f / "annotations_positions" / "1.json"), r"1\.json: frame 1 occurs twice"),
    "centimetres": (
        centimetres,
        r"extr_Camera1\.xml: rvec and tvec put the camera at \(0, 0, 400\) m, needs .* the unit of MultiviewX is metres",
    ),
    "turned away": (looking_away, r"calibrations: no camera sees any point of the grid, needs rvec and tvec with x_camera = R x_world \+ t"),
    "unknown cameras": (
        lambda f: (f / "calibrations/extrinsic/extr_Camera1.xml").rename(f / "calibrations/extrinsic/extr_left.xml"),
        r"extrinsic: has extr_left\.xml, needs extr_CVLab1\.xml to extr_IDIAP3\.xml \(WILDTRACK\) or extr_Camera1\.xml",
    ),
    "no intrinsics": (
        lambda f: shutil.rmtree(f / "calibrations/intrinsic"),
        r"calibrations: has none of intrinsic_zero, intrinsic, intrinsic_original",
    ),
    "detections of nobody's camera": (detections_of("C7"), r"C7\.txt: is of camera 'C7', needs one of C1, C2"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_invalid_content_is_named(tmp_path: Path, fault: str) -> None:
    change, message = FAULTS[fault]
    change(multiviewx(tmp_path))
    with pytest.raises(ValueError, match=message) as error:
        read_wildtrack(tmp_path)
    assert "\n" not in str(error.value)


def test_a_missing_frame_keeps_the_numbers_of_the_others_and_is_told(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    multiviewx(tmp_path, frames=3)
    (tmp_path / POSITIONS).unlink()
    detections_of("C2")(tmp_path)
    recording = read_wildtrack(tmp_path)
    assert (recording.frames, sorted(recording.truth or ())) == (3, [0, 2])
    assert caplog.messages[0].endswith("00001.json missing, so 1 of 3 frames have nobody in the truth")
    boxes, confidence = recording.detections["C2"][0]
    assert_array_equal(boxes, [[1, 2, 30, 40]])
    assert confidence.tolist() == [0.9]


@pytest.mark.parametrize(
    ("matrix", "message"),
    [
        (np.eye(3)[:2], r"intr_Camera1\.xml:line 3: camera_matrix has shape \(2, 3\), needs 3 x 3 numbers"),
        (np.diag([-1000.0, 1000, 1]), r"intr_Camera1\.xml: camera_matrix is .*, needs \[\[fx, 0, cx\], \[0, fy, cy\], \[0, 0, 1\]\]"),
    ],
)
def test_a_wrong_camera_matrix_is_named(tmp_path: Path, matrix: np.ndarray, message: str) -> None:
    multiviewx(tmp_path)
    storage = cv2.FileStorage(str(tmp_path / "calibrations/intrinsic/intr_Camera1.xml"), cv2.FILE_STORAGE_WRITE)
    storage.write("camera_matrix", matrix)
    storage.write("distortion_coefficients", np.zeros((1, 5)))
    storage.release()
    with pytest.raises(ValueError, match=message):
        read_wildtrack(tmp_path)


def test_a_distortion_that_folds_within_the_image_is_named(tmp_path: Path) -> None:
    multiviewx(tmp_path)
    edited(tmp_path, "calibrations/intrinsic/intr_Camera1.xml", "0. 0. 0. 0. 0.", "-2. 0. 0. 0. 0.")
    with pytest.raises(ValueError, match=r"intr_Camera1\.xml: distortion .* folds within the image"):
        read_wildtrack(tmp_path)
