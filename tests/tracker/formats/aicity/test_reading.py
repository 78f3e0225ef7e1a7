"""A scene of AI City as a recording: names of files, people alone, and bad content with its file."""

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from tracker.formats.aicity.files import AiCityObject, write_calibration, write_ground_truth
from tracker.formats.aicity.reading import is_aicity, read_aicity
from tracker.formats.opening import open_recording
from tracker.geometry.cameras import Pinhole
from tracker.recordings import RecordingCamera

AHEAD = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
"""Looks along x of the world."""


def camera(z: float = 3.0) -> RecordingCamera:
    return RecordingCamera.of_opencv(Pinhole(1280, 720, 900.0, 900.0, 640.0, 360.0), AHEAD, -AHEAD @ np.array([0.0, 0.0, z]))


def standing(kind: str, identity: int, x: float, height: float = 1.8) -> AiCityObject:
    return AiCityObject(kind, identity, np.array([x, 0.0, height / 2]), np.array([0.5, 0.5, height]), np.zeros(3))


def write(folder: Path, cameras: dict[str, RecordingCamera], boxes: dict[str, str] | None = None) -> Path:
    (folder / "detections").mkdir(parents=True)
    write_calibration(folder / "calibration.json", 30.0, cameras)
    write_ground_truth(folder / "ground_truth.json", {0: [standing("Person", 1, 5.0), standing("Forklift", 1, 8.0)], 2: [standing("Person", 4, 6.0)]})
    for name, text in (boxes or {}).items():
        (folder / "detections" / name).write_text(text)
    return folder


def test_people_stand_below_the_middle_of_their_boxes(tmp_path: Path) -> None:
    scene = write(tmp_path / "s", {"Camera": camera(), "Camera_01": camera()}, {"Camera_0001.txt": "4,-1,600,300,40,90,0.8,-1,-1,-1\n"})
    assert is_aicity(scene)
    read = read_aicity(scene)
    assert read.truth is not None
    assert_array_equal(read.truth[0][0], [1])
    assert_allclose(read.truth[0][1], [[5.0, 0.0, 0.0]], atol=1e-12)
    assert read.source["left_out"] == {"Forklift": 1}
    assert (read.frames, read.rate) == (4, 30.0)
    # The file that the challenge's naming of videos would have is found for the camera's id.
    assert_allclose(read.detections["Camera_01"][3][0], [[600, 300, 40, 90]])
    foot = read.cameras["Camera"].camera.pixels_from_bearings(read.cameras["Camera"].pose.inverse().apply(read.truth[0][1]))[0]
    assert_allclose(foot, [[640.0, 360.0 + 900 * 3 / 5]])


def test_a_scene_without_truth_is_read(tmp_path: Path) -> None:
    scene = write(tmp_path / "s", {"C": camera()}, {"C.txt": "1,-1,600,300,40,90,0.8,-1,-1,-1\n"})
    (scene / "ground_truth.json").unlink()
    assert read_aicity(scene).truth is None
    assert len(next(iter(read_aicity(scene).sequence().ticks)).views[0].detections) == 1


def test_other_folders_are_no_scenes(tmp_path: Path) -> None:
    assert not is_aicity(tmp_path)
    (tmp_path / "calibration.json").write_text('{"cameras": {}}')
    assert not is_aicity(tmp_path)


def test_bad_scenes_are_refused_with_their_file(tmp_path: Path) -> None:
    rates = write(tmp_path / "rates", {"A": camera(), "B": camera()})
    (rates / "calibration.json").write_text((rates / "calibration.json").read_text().replace('"30"', '"10"', 1))
    with pytest.raises(ValueError, match=r"calibration.json: fps is 10 and 30, needs the same of all cameras"):
        read_aicity(rates)
    with pytest.raises(ValueError, match=r"detections/B.txt: is of camera 'B', calibration.json has A"):
        read_aicity(write(tmp_path / "names", {"A": camera()}, {"B.txt": ""}))
    below = write(tmp_path / "below", {"A": camera(z=-3.0)})
    with pytest.raises(ValueError, match=r"calibration.json: .*A.* below the ground"):
        open_recording(below)
    assert open_recording(below, strict=False).cameras["A"].pose.translation[2] == pytest.approx(-3)
