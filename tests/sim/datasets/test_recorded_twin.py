"""The twin of a recording: its people on their paths before its cameras, in a hall that fits, rendered or not."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from sim.datasets.twin import Twin, generate_twin, plan_of, recording_of, true_motion
from tracker.formats.opening import open_recording
from tracker.geometry import Array, Pose
from tracker.geometry.cameras import pinhole
from tracker.geometry.ground import Flat
from tracker.geometry.lenses import Pinhole
from tracker.recordings import Recording, RecordingCamera
from tracker.recordings.folder import write_recording
from tracker.recordings.recording import RecordingRobot
from tracker.sequence.reader import read_sequence
from tracker.sequence.truth_tables import read_boxes
from tracker.types import Start
from worlds import catalogue

FRAMES, LEVEL = 5, 0.4
LENS = Pinhole(160, 120, 90.0, 92.0, 80.0, 58.0, (-0.05, 0.01, 0.0, 0.0, 0.0))


def feet(person: int, frame: int) -> Array:
    """Feet (3,) m of person 0, who walks, of person 7, who stands, and of person 70000, who comes in frame 2."""
    return {0: np.array([1.0 + 0.3 * frame, 1.0, LEVEL]), 7: np.array([3.0, 2.0, LEVEL]), 70000: np.array([4.0, 1.0 + 0.2 * frame, LEVEL])}[person]


@pytest.fixture
def source(tmp_path: Path) -> Path:
    """A recording of a small room: two cameras of different models, images of one of them, and no detections."""
    cameras = {
        "C1": RecordingCamera.looking_at(LENS, [0.2, 0.3, LEVEL + 2.9], [3.0, 2.0, LEVEL + 0.8]),
        "C2": RecordingCamera.looking_at(pinhole(160, 120, 1.4), [5.0, 3.0, LEVEL + 2.0], [2.0, 1.0, LEVEL + 0.8]),
    }
    truth = {}
    for frame in range(FRAMES):
        people = [0, 7, 70000] if frame >= 2 else [0, 7]
        truth[frame] = np.array(people), np.array([feet(person, frame) for person in people])
    recording = Recording(4.0, cameras, {}, truth, area=[[0.5, 0.5], [4.8, 2.9]], ground=Flat(LEVEL))
    folder = tmp_path / "source"
    folder.mkdir()
    write_recording(folder, recording)
    (folder / "images" / "C2").mkdir(parents=True)
    for frame in range(FRAMES):
        cv2.imwrite(str(folder / "images" / "C2" / f"{frame + 1:06d}.png"), np.full((120, 160, 3), 40 * frame, dtype=np.uint8))
    return folder


def made(out: Path, source: Path, render: bool = False, workers: int = 1, **changes: object) -> list[str]:
    """Write the twin, and what is said of it."""
    return list(generate_twin(replace(Twin(source), **changes), out, render, workers))


def test_the_hall_encloses_paths_and_cameras(source: Path) -> None:
    twin = Twin(source)
    motion = true_motion(twin)
    plan = plan_of(motion)
    assert plan.walled
    # Cameras keep 0.15 m and paths 0.6 m from the walls; the area is inside.
    np.testing.assert_allclose(plan.extent, [[0.05, 0.15], [5.15, 3.15]])
    assert plan.wall_height == pytest.approx(3.3)
    found = recording_of(twin, motion)
    assert found.scenario.world == "hall:room=0.05:0.15:5.15:3.15"
    assert found.provenance["twin"]["ids"] == [0, 7, 70000]
    world = catalogue.build(found.scenario.world, np.random.default_rng(0), 0.0)
    assert world.feet.free_at([feet(person, frame)[:2] for person in (0, 7) for frame in range(FRAMES)]).all()


def test_without_images_the_twin_is_a_recording_with_the_same_people(source: Path, tmp_path: Path) -> None:
    lines = made(tmp_path / "twin", source)
    made(tmp_path / "again", source)
    same_files(tmp_path / "twin", tmp_path / "again")
    assert lines[1] == "3 people in 5 frames, before 2 cameras"
    original, twin = open_recording(source), open_recording(tmp_path / "twin")
    assert twin.rate == original.rate
    assert list(twin.cameras) == ["C1", "C2"]
    assert twin.cameras["C1"].camera == LENS
    np.testing.assert_allclose(np.asarray(twin.area), np.asarray(original.area))
    assert twin.truth is not None
    for frame, (ids, places) in twin.truth.items():
        known = [0, 7, 70000] if frame >= 2 else [0, 7]
        assert ids.tolist() == [[0, 7, 70000].index(person) + 1 for person in known]
        np.testing.assert_allclose(places, [feet(person, frame) for person in known], atol=0.05)
    found = twin.detections["C2"]
    assert sum(len(boxes) for boxes, _ in found.values()) >= FRAMES
    # Each box of the person who stands has its feet where the camera sees them.
    camera = twin.cameras["C2"]
    low = camera.camera.pixels_from_bearings(camera.pose.inverse().apply(feet(7, 0)[None]))[0][0]
    bottoms = np.array([[b[0] + b[2] / 2, b[1] + b[3]] for boxes, _ in found.values() for b in boxes])
    assert np.hypot(*(bottoms - low).T).min() < 6


def same_files(one: Path, two: Path) -> None:
    names = sorted(path.relative_to(one) for path in one.rglob("*") if path.is_file())
    assert names == sorted(path.relative_to(two) for path in two.rglob("*") if path.is_file())
    for name in names:
        assert (one / name).read_bytes() == (two / name).read_bytes(), name


@pytest.mark.command
@pytest.mark.render
def test_rendered_it_is_a_sequence_with_any_number_of_workers(source: Path, tmp_path: Path) -> None:
    for workers in (1, 2):
        lines = made(tmp_path / f"{workers}", source, True, workers, frames=4, robots=1, width=64)
        assert lines[1] == f"{tmp_path / f'{workers}' / 'twin.png'} shows a frame beside the source's"
    same_files(tmp_path / "1", tmp_path / "2")
    sequence = read_sequence(tmp_path / "1")
    assert list(sequence.setup.mounts) == ["robot_0_camera", "C1", "C2"]
    assert sequence.setup.mounts["C1"].camera == LENS
    boxes = read_boxes(tmp_path / "1")[3, "C2"]
    assert sorted(boxes.person.tolist()) == [1, 2, 3]
    picture = cv2.imread(str(tmp_path / "1" / "twin.png"))
    assert picture is not None
    assert picture.shape == (150, 2 * 166, 3)
    # The twin of the twin, with its images or by one of its cameras, has the same people again.
    made(tmp_path / "again", tmp_path / "1", cameras=("2",))
    again = open_recording(tmp_path / "again")
    assert list(again.cameras) == ["C2"]
    assert again.truth is not None
    assert sequence.truth is not None
    for one in sequence.truth:
        np.testing.assert_allclose(again.truth[one.index][1], one.feet, atol=0.1)


def test_paths_stay_free_in_a_furnished_hall(source: Path, tmp_path: Path) -> None:
    made(tmp_path / "twin", source, difficulty=1.0)
    twin = open_recording(tmp_path / "twin")
    assert twin.truth is not None
    assert np.ptp(np.concatenate([places[:, 2] for _, places in twin.truth.values()])) > 0.005


def test_wildtrack_is_a_square(data: Callable[..., Path]) -> None:
    motion = true_motion(Twin(data("wildtrack"), frames=40))
    plan = plan_of(motion)
    assert not plan.walled
    assert len(motion.cameras) == 7
    assert motion.rate == 2.0
    places = motion.position[np.isfinite(motion.position).all(axis=2)]
    assert ((places > plan.extent[0] + 0.5) & (places < plan.extent[1] - 0.5)).all()


def test_pets_by_its_folder_is_the_twin_by_its_files(data: Callable[..., Path], tmp_path: Path) -> None:
    folder = data("pets2009", "S2.L1")
    lines = made(tmp_path / "twin", folder, cameras=("1", "5"), frames=2)
    assert lines[0] == f"{tmp_path / 'twin'}: a recording without images (README.md in it); `pilsim track {tmp_path / 'twin'}` tracks it"
    twin = open_recording(tmp_path / "twin")
    assert list(twin.cameras) == ["View_001", "View_005"]
    assert twin.truth is not None
    assert len(twin.truth[0][0]) >= 3


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"frames": 9}, "frames is 9, needs 1 to 5, the frames of"),
        ({"cameras": ("C9",)}, "camera is 'C9', needs one of C1, C2"),
        ({"robots": 1}, "robots is 1, needs 0 without rendering"),
        ({"workers": 0}, "workers is 0, needs 1 to 1024"),
    ],
)
def test_twins_that_do_not_fit_are_refused(source: Path, tmp_path: Path, changes: dict[str, object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        made(tmp_path / "out", source, **changes)
    assert not (tmp_path / "out").exists()


def test_sources_that_cannot_have_a_twin_are_refused(source: Path, tmp_path: Path, data: Callable[..., Path]) -> None:
    (tmp_path / "blind" / "detections").mkdir(parents=True)
    for name in ("recording.json", "detections/C1.txt"):
        (tmp_path / "blind" / name).write_bytes((source / "recording.json").read_bytes() if name.endswith("json") else b"")
    with pytest.raises(ValueError, match=r"blind: has no truth, which a twin needs"):
        made(tmp_path / "out", tmp_path / "blind")
    with pytest.raises(ValueError, match=r"MRCLAM_Dataset1: is a UTIAS set .*needs a source with cameras and boxes"):
        made(tmp_path / "out", data("utias", "MRCLAM_Dataset1"))
    cameras = {"C2": RecordingCamera(LENS, Pose.identity(), "r0")}
    carried = Recording(4.0, cameras, {}, {0: (np.array([1]), np.zeros((1, 3)))}, robots={"r0": RecordingRobot(Start(Pose.identity(), np.eye(6)))})
    (tmp_path / "carried").mkdir()
    write_recording(tmp_path / "carried", carried)
    with pytest.raises(ValueError, match=r"camera C2 is on a robot, needs cameras that stand still; --cameras chooses some"):
        made(tmp_path / "out", tmp_path / "carried")
    assert not (tmp_path / "out").exists()
