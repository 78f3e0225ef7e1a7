"""The picture of a calibration: what a camera sees of the ground, and that each kind of recording is drawn."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from sim.visualization.calibration_picture import draw_calibration, footprint
from tests.tracker.recordings.walked_room import planted, walked_room
from tracker.geometry import Pose
from tracker.geometry.cameras import Panorama, Pinhole
from tracker.recordings import Recording, RecordingCamera
from tracker.recordings.calibration_check import check_calibration
from tracker.recordings.calibration_feet import CalibrationCase
from tracker.recordings.images import ImageFiles


def outline(recording: Recording, name: str, reach: float) -> np.ndarray:
    return footprint(recording.cameras[name], CalibrationCase.of(recording), reach)


def test_a_camera_that_looks_straight_down_sees_a_rectangle() -> None:
    """3 m high, focal length 300 px: 600 x 400 px are 6 x 4 m of ground."""
    down = Pose(np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]]), np.array([1.0, 2.0, 3.0]))
    recording = Recording(4.0, {"C1": RecordingCamera(Pinhole(600, 400, 300.0, 300.0, 299.5, 199.5), down)}, frames=1)
    seen = outline(recording, "C1", 20.0)
    assert np.allclose(np.sort(np.ptp(seen, axis=0)), [4.0, 6.0], atol=0.2)
    assert np.allclose(seen.mean(axis=0), [1.0, 2.0], atol=0.2)


def test_a_panorama_sees_all_around_up_to_the_reach() -> None:
    recording = Recording(4.0, {"C1": RecordingCamera(Panorama(512, 256), Pose(np.eye(3), np.array([0.0, 0.0, 1.5])))}, frames=1)
    seen = outline(recording, "C1", 10.0)
    assert np.hypot(*seen.T).max() == pytest.approx(10.0, abs=0.3)
    assert np.allclose(seen.min(axis=0), -10.0, atol=0.3)


def test_a_camera_below_the_ground_sees_none_of_it() -> None:
    low = Pose(np.eye(3), np.array([0.0, 0.0, -1.0]))
    recording = Recording(4.0, {"C1": RecordingCamera(Panorama(512, 256), low)}, frames=1)
    assert len(outline(recording, "C1", 10.0)) == 0


@pytest.mark.render
def test_images_are_drawn_where_there_are_some(tmp_path: Path) -> None:
    recording = walked_room(people=3, frames=20)
    red = np.zeros((720, 1280, 3), dtype=np.uint8)
    red[..., 2] = 255
    cv2.imwrite(str(tmp_path / "red.png"), red)
    files = ImageFiles(dict.fromkeys(range(20), tmp_path / "red.png"))
    pages = []
    for name, one in (("plain", recording), ("images", replace(recording, images={"C1": files}))):
        draw_calibration(one, check_calibration(one), tmp_path / f"{name}.png")
        pages.append(cv2.imread(str(tmp_path / f"{name}.png")).astype(int))
    reddish = [((page[..., 2] > 200) & (page[..., 1] < 90)).mean() for page in pages]
    assert reddish[1] > reddish[0] + 0.05


@pytest.mark.render
@pytest.mark.parametrize("error", ["mm", "area in mm"])
def test_wrong_calibrations_are_drawn(tmp_path: Path, error: str) -> None:
    _, wrong, _ = planted(walked_room(people=3, frames=40))[error]
    draw_calibration(wrong, check_calibration(wrong), tmp_path / "wrong.png")
    assert min(cv2.imread(str(tmp_path / "wrong.png")).shape[:2]) > 400
