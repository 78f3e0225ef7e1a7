"""The twin of PETS 2009: paths and statures from boxes, and the overlap of its boxes with the annotated ones."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from sim.datasets.twin import Twin, annotated_overlaps, confine_rovers, draw_twin, recording_of, true_motion
from sim.recording.record import write_sequence
from tests.sim.plaza import plaza
from tests.tracker.formats.test_pets2009 import CAMERA
from tracker.geometry import Array
from tracker.geometry.cameras import Panorama, Tsai
from tracker.io.tsai_xml import read_camera
from tracker.pipeline import track
from tracker.sequence.reader import read_sequence
from tracker.sequence.truth_tables import read_boxes, read_views

FRAMES = 8
STATURE = {4: 1.62, 9: 1.85, 17: 2.4}


def feet(person: int, frame: int) -> Array:
    """Feet (3,) m: persons 4 and 9 walk at 1.3 m/s, and person 17 appears in frame 3."""
    start, step = {4: ([-8.0, -6.0], [0.18, 0.02]), 9: ([-2.0, -3.0], [-0.1, -0.15]), 17: ([-5.0, 0.0], [0.0, -0.18])}[person]
    return np.array([*(np.array(start) + frame * np.array(step)), 0.0])


@pytest.fixture
def pets(tmp_path: Path) -> Twin:
    """A synthetic annotation of three people in the image of the real View_001."""
    (tmp_path / "View_001.xml").write_text(CAMERA)
    _, camera, T = read_camera(tmp_path / "View_001.xml")
    lines = ["<dataset>"]
    for frame in range(FRAMES):
        lines.append(f'<frame number="{frame}"><objectlist>')
        for person in (4, 9, 17) if frame >= 3 else (4, 9):
            low, high = camera.pixels_from_bearings(T.inverse().apply(feet(person, frame) + np.outer([0.0, STATURE[person]], [0, 0, 1])))[0]
            h = low[1] - high[1]
            lines.append(f'<object id="{person}"><box h="{h:.4f}" w="{0.35 * h:.4f}" xc="{low[0]:.4f}" yc="{low[1] - h / 2:.4f}"/></object>')
        lines.append("</objectlist></frame>")
    (tmp_path / "a.xml").write_text("\n".join([*lines, "</dataset>"]))
    return Twin(tmp_path / "a.xml", robots=1, width=256, calibration=tmp_path)


def test_paths_and_statures_are_recovered_from_boxes(pets: Twin) -> None:
    walkers = true_motion(pets)
    assert walkers.ids.tolist() == [4, 9, 17]
    assert np.isnan(walkers.position[2, :3]).all()
    for row, person in enumerate((4, 9, 17)):
        for frame in range(3 if person == 17 else 0, FRAMES):
            np.testing.assert_allclose(walkers.position[row, frame], feet(person, frame)[:2], atol=1e-3)
    # The top of the box is above the feet, not above the middle of its lower edge: this costs a centimetre. Statures end at 2 m.
    np.testing.assert_allclose(walkers.stature, [1.62, 1.85, 2.0], atol=0.01)


def test_rovers_are_confined_to_the_area_of_the_paths() -> None:
    position = np.array([[[-8.0, -6.0], [-4.0, -6.0], [np.nan, np.nan]], [[-5.0, 0.0], [np.nan, np.nan], [-5.0, -3.0]]])
    wheels = confine_rovers(plaza(), position).wheels
    inside = np.array([[-11.0, -9.0], [-1.0, 3.0], [-6.0, -3.0]])
    outside = np.array([[-13.0, -6.0], [1.0, 0.0], [-5.0, 5.0], [-5.0, -11.0]])
    assert wheels.free_at(inside).all()
    assert not wheels.free_at(outside).any()


@pytest.mark.render
def test_the_twin_is_a_sequence_for_the_tracker(pets: Twin, tmp_path: Path) -> None:
    write_sequence(recording_of(replace(pets, frames=6), world=plaza()), tmp_path / "twin")
    sequence = read_sequence(tmp_path / "twin")
    assert list(sequence.setup.mounts) == ["robot_0_camera", "View_001"]
    assert isinstance(sequence.setup.mounts["robot_0_camera"].camera, Panorama)
    assert isinstance(sequence.setup.mounts["View_001"].camera, Tsai)
    _, camera, T = read_camera(tmp_path / "twin" / "calibration" / "View_001.xml")
    assert camera == sequence.setup.mounts["View_001"].camera
    assert sequence.truth is not None
    for truth in sequence.truth:
        np.testing.assert_allclose(truth.T_world_robot["View_001"].log(), T.log(), atol=1e-8)
        assert truth.person_id.tolist() == ([4, 9, 17] if truth.index >= 3 else [4, 9])
        for person, where in zip(truth.person_id.tolist(), truth.feet, strict=True):
            assert np.linalg.norm(where - feet(person, truth.index)) < 0.15
    assert [sorted(v.camera for v in tick.views) for tick in sequence.ticks] == [["View_001", "robot_0_camera"]] * 6
    assert json.loads((tmp_path / "twin" / "scenario.json").read_text())["twin"]["views"] == [1]
    estimates = list(track(sequence.setup, sequence.ticks))
    np.testing.assert_allclose(estimates[-1].T_world_robot["View_001"].translation, T.translation, atol=1e-9)
    views = read_views(tmp_path / "twin")
    for (frame, _), view in views.items():
        assert set(view.boxes.person.tolist()) <= set(sequence.truth[frame].person_id.tolist())
    assert max(len(view.boxes.person) for view in views.values()) == 3


@pytest.mark.render
def test_boxes_of_the_twin_overlap_the_annotated_boxes(data: Callable[..., Path], tmp_path: Path) -> None:
    folder = data("pets2009")
    pets = Twin(folder / "S2.L1" / "annotations" / "PETS2009-S2L1.xml", frames=10, robots=1, width=128, calibration=folder / "calibration")
    motion = true_motion(pets)
    write_sequence(recording_of(pets, motion, plaza()), tmp_path / "twin")
    overlaps = annotated_overlaps(motion, read_boxes(tmp_path / "twin"))
    assert len(overlaps) == 30
    assert np.median(overlaps) >= 0.6
    path = draw_twin(motion, tmp_path / "twin")
    assert path == tmp_path / "twin" / "twin.png"
    picture = cv2.imread(str(path))
    # The picture has the real frame, too, where the video is installed.
    assert picture is not None
    assert picture.shape[0] == 576 + 30
    assert picture.shape[1] in (768 + 6, 2 * (768 + 6))
    # Without the annotated view, there is nothing to compare with.
    assert not true_motion(replace(pets, cameras=("View_005",))).boxes


@pytest.mark.parametrize(
    ("change", "old", "new", "message"),
    [
        ({"cameras": ("1", "6")}, "", "", r"camera is '6', needs one of View_001"),
        ({"source": Path("nowhere.xml")}, "", "", r"nowhere.xml: no such file"),
        ({"difficulty": 0.5}, "", "", r"--difficulty is for halls"),
        ({"frames": 9}, "", "", r"frames is 9, needs 1 to 8"),
        ({}, '<box h="', '<box h="-', r"a.xml:line 3: field box.h is -\d+"),
        ({}, "object id", "thing id", r"a.xml: nobody is in the truth of 8 frames"),
        ({}, "</dataset>", "", r"a.xml: is not XML"),
    ],
)
def test_invalid_twins_are_refused(pets: Twin, tmp_path: Path, change: dict[str, object], old: str, new: str, message: str) -> None:
    text = pets.source.read_text().replace("</object>", "</thing>" if new == "thing id" else "</object>")
    pets.source.write_text(text.replace(old, new) if old else text)
    with pytest.raises(ValueError, match=message):
        recording_of(replace(pets, **change), world=plaza())
