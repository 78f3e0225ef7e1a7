"""Cases of a user's cameras: what is known of the recording, and what must be said."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from sim.tuning.population import open_cameras, user_case
from sim.tuning.scoring import evaluate
from tracker.formats.source_options import SourceOptions
from tracker.geometry.cameras import Pinhole
from tracker.recordings import RecordingCamera
from tracker.recordings.camera_json import camera_to

LENS = Pinhole(1280, 720, 800.0, 800.0, 639.5, 359.5)


@pytest.fixture
def calibration(tmp_path: Path) -> Path:
    """Two cameras in corners of 8 x 6 m, without boxes and truth."""
    cameras = {f"C{k}": RecordingCamera.looking_at(LENS, (x, y, 2.5), (4, 3, 1)) for k, (x, y) in enumerate([(0, 0), (8, 6)], 1)}
    content = {"rate": 20.0, "cameras": {name: camera_to(camera) for name, camera in cameras.items()}}
    (tmp_path / "recording.json").write_text(json.dumps(content))
    return tmp_path


def test_cameras_without_truth_need_a_number_of_people(calibration: Path) -> None:
    with pytest.raises(ValueError, match=rf"^{calibration}: has no truth, needs the number of people at once: --people$"):
        open_cameras(calibration, SourceOptions(), None)
    with pytest.raises(ValueError, match="--people is 0, needs 1 to 100"):
        open_cameras(calibration, SourceOptions(), 0)
    user = open_cameras(calibration, SourceOptions(), 4)
    assert (user.people, user.models) == (4, ())
    # The ground that both see lies between them.
    assert (user.area[0] >= [-2.0, -2.0]).all()
    assert (user.area[1] <= [10.0, 8.0]).all()


def test_cases_of_other_cameras_have_other_files(calibration: Path, tmp_path: Path) -> None:
    four, five = (open_cameras(calibration, SourceOptions(), people) for people in (4, 5))
    assert open_cameras(calibration, SourceOptions(), 4).key == four.key != five.key
    folder = tmp_path / "cases"
    slow = user_case(0, 1, folder, four).recording
    user_case(0, 1, folder, five)
    assert len(list(folder.iterdir())) == 2
    # Of 20 frames/s, every second one is kept.
    assert slow.rate == 10.0


def test_cameras_without_poses_are_refused(tmp_path: Path) -> None:
    (tmp_path / "recording.json").write_text(json.dumps({"rate": 10.0, "cameras": {"C1": {"width": 640, "height": 480}}}))
    with pytest.raises(ValueError, match="calibrat"):
        open_cameras(tmp_path, SourceOptions(), 3)


@pytest.mark.data
def test_a_detector_is_fitted_to_each_view_of_a_recording_with_truth(data: Callable[..., Path], tmp_path: Path) -> None:
    user = open_cameras(data("cmc", "CMC1"), SourceOptions(frames=(0, 130)), None)
    assert [len(user.models), user.people] == [4, 2]
    case = user_case(0, 1, tmp_path, user)
    assert case.kind == "yours"
    for camera, known in zip(case.recording.cameras.values(), user.recording.cameras.values(), strict=True):
        np.testing.assert_allclose(camera.pose.translation, known.pose.translation, atol=0.15)
    assert evaluate(case)["mota"] > 0.7
