"""The folder of a recording: what was written is read back, and every error names file and field."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from tracker.formats.opening import format_of, open_recording, open_sequence
from tracker.formats.source_options import SourceOptions
from tracker.geometry import Pose
from tracker.geometry.cameras import Panorama, Pinhole
from tracker.geometry.ground import Flat, Grid
from tracker.recordings import Recording, RecordingCamera, RecordingRobot
from tracker.recordings.folder import read_recording, write_recording
from tracker.types import Odometry, Start

LENS = Pinhole(640, 480, 500.0, 500.0, 319.5, 239.5, (0.05, -0.01, 0.001, 0.002, 0.0))


def looking(x: float, y: float, heading: float) -> Pose:
    """T_world_camera of a camera 3 m high that looks 20° down."""
    c, s, down = np.cos(heading), np.sin(heading), np.radians(20)
    level = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    tilt = np.array([[np.cos(down), 0.0, np.sin(down)], [0.0, 1.0, 0.0], [-np.sin(down), 0.0, np.cos(down)]])
    return Pose(level @ tilt, np.array([x, y, 3.0]))


def small() -> Recording:
    """Two cameras, three frames, two people."""
    boxes = {
        0: (np.array([[100.0, 120.0, 40.0, 90.0]]), np.array([0.9])),
        2: (np.array([[102.5, 120.0, 40.0, 90.0], [300, 100, 30, 80]]), np.array([0.7, 3.5])),
    }
    people = {frame: (np.array([4, 7]), np.array([[1.0 + 0.1 * frame, 2.0, 0.0], [3.0, 1.0 / 3.0, 0.0]])) for frame in range(3)}
    cameras = {"C1": RecordingCamera(LENS, looking(-4.0, 0.0, 0.0)), "C2": RecordingCamera(LENS, looking(0.0, 8.0, -np.pi / 2))}
    return Recording(5.0, cameras, {"C1": boxes, "C2": {}}, people, area=[[0, 0], [6, 5]])


def same_recording(a: Recording, b: Recording) -> None:
    assert (a.rate, a.frames, a.height, list(a.cameras)) == (b.rate, b.frames, b.height, list(b.cameras))
    for name, camera in a.cameras.items():
        assert camera.camera == b.cameras[name].camera
        assert camera.robot == b.cameras[name].robot
        assert abs((camera.pose.inverse() @ b.cameras[name].pose).log()).max() < 1e-9
        boxes, again = a.detections.get(name, {}), b.detections.get(name, {})
        assert sorted(k for k, (box, _) in boxes.items() if len(box)) == sorted(again)
        for frame, (box, confidence) in again.items():
            np.testing.assert_array_equal(box, boxes[frame][0])
            np.testing.assert_array_equal(confidence, boxes[frame][1])
    assert a.truth is not None
    assert b.truth is not None
    for frame, (ids, places) in a.truth.items():
        np.testing.assert_array_equal(ids, b.truth[frame][0])
        np.testing.assert_array_equal(places, b.truth[frame][1])


def test_a_recording_is_read_as_it_was_written(tmp_path: Path) -> None:
    write_recording(tmp_path, small())
    assert format_of(tmp_path).name == "recording"
    same_recording(small(), open_recording(tmp_path))
    sequence = open_sequence(tmp_path)
    assert len(sequence.ticks) == 3
    assert [len(view.detections) for tick in sequence.ticks for view in tick.views] == [1, 0, 0, 0, 2, 0]
    assert sequence.setup.area is not None
    assert [len(truth.person_id) for truth in sequence.truth or ()] == [2, 2, 2]


def test_pillars_are_kept_and_checked(tmp_path: Path) -> None:
    write_recording(tmp_path, replace(small(), pillars=np.array([[1.0, 2.0, 0.1, 0.0, 2.4]])))
    assert read_recording(tmp_path).pillars.tolist() == [[1.0, 2.0, 0.1, 0.0, 2.4]]
    file = tmp_path / "recording.json"
    file.write_text(json.dumps(json.loads(file.read_text()) | {"pillars": [[1, 2, 0, 0, 2]]}))
    with pytest.raises(ValueError, match=r"recording\.json: pillars is .*, needs rows of x, y, radius"):
        read_recording(tmp_path)


def test_robots_terrain_and_images_are_kept(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    heights = rng.uniform(0, 0.2, (5, 6))
    motion = {k: Odometry(Pose.planar(0.1, 0.0, 0.02), np.eye(6) * 1e-4, np.array([0.0, 0.0, 1.0])) for k in range(3)}
    robot = RecordingRobot(Start(Pose.planar(1.0, 1.0, 0.5), np.eye(6) * 1e-3), motion, {k: Pose.planar(1.0 + 0.1 * k, 1.0, 0.5) for k in range(3)})
    mounted = RecordingCamera(Panorama(64, 32), Pose(np.eye(3), np.array([0.1, 0.0, 0.5])), "r0")
    given = small()
    whole = replace(
        given, cameras={**given.cameras, "P": mounted}, robots={"r0": robot}, ground=Grid(heights, np.array([-5.0, -5.0]), 4.0), occluders=None
    )
    folder = tmp_path / "r"
    folder.mkdir()
    write_recording(folder, whole)
    (folder / "images" / "P").mkdir(parents=True)
    for k in range(3):
        cv2.imwrite(str(folder / "images" / "P" / f"{k + 1:06d}.png"), np.full((32, 64, 3), 40 * k, dtype=np.uint8))
    again = open_recording(folder)
    same_recording(whole, again)
    np.testing.assert_array_equal(again.ground.heights, heights)  # type: ignore[attr-defined]
    sequence = again.sequence()
    assert sequence.setup.moving_robots == ("r0",)
    for k, tick in enumerate(sequence.ticks):
        view = tick.views[2]
        assert view.odometry is not None
        assert view.image is not None
        assert int(view.image.mean()) == 40 * k
        np.testing.assert_allclose(view.odometry.covariance, np.eye(6) * 1e-4)
    assert (sequence.truth or ())[2].T_world_robot["r0"].translation[0] == pytest.approx(1.2)


def changed(folder: Path, change: Callable[[dict[str, Any]], object]) -> Path:
    write_recording(folder, small())
    content = json.loads((folder / "recording.json").read_text())
    change(content)
    (folder / "recording.json").write_text(json.dumps(content))
    return folder


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda c: c.pop("rate"), r"recording.json: rate is missing, needs a number"),
        (lambda c: c.update(rate=0), r"recording.json: rate is 0, needs a number from 0.0001"),
        (lambda c: c.update(cameras={}), r"recording.json: cameras is missing or empty"),
        (lambda c: c.update(area=[[0, 0]]), r"recording.json: area is .*needs two corners"),
        (lambda c: c.update(area=[[5, 5], [0, 0]]), r"recording.json: area is .*the lowest first"),
        (lambda c: c.update(height=[2.0, 1.0]), r"recording.json: height is .*the lower first"),
        (lambda c: c.update(ground="none.npz"), r"none.npz: "),
        (lambda c: c.update(ground="../terrain.npz"), r"recording.json: ground is '../terrain.npz'"),
        (lambda c: c.update(format="pilsim-recording/9"), r"recording.json: format is 'pilsim-recording/9', needs 'pilsim-recording/1'"),
        (lambda c: c.update(framerate=4), r"recording.json: field 'framerate' is unknown, needs one of"),
        (lambda c: c["cameras"]["C1"].update(R=[[1, 0, 0], [0, 1, 0], [0, 0.5, 1]]), r"recording.json: cameras.C1.*R is no rotation"),
        (lambda c: c["cameras"]["C1"].update(robot="r9"), r"recording.json: cameras.C1.robot is 'r9', needs one of robots.json"),
        (lambda c: c.update(cameras={"a b": c["cameras"]["C1"]}), r"recording.json: camera 'a b' needs a name without blanks"),
    ],
)
def test_invalid_fields_are_named(tmp_path: Path, change: Callable[[dict[str, Any]], object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        open_recording(changed(tmp_path, change))


def test_a_camera_below_the_ground_is_refused(tmp_path: Path) -> None:
    def sink(content: dict[str, Any]) -> None:
        content["ground"] = 5.0

    folder = changed(tmp_path, sink)
    with pytest.raises(ValueError, match=r"recording.json: cameras.C1.t puts the camera at \(-4.00, 0.00, 3.00\) m, 2.00 m below the ground"):
        open_recording(folder)
    assert open_recording(folder, strict=False).ground == Flat(5.0)


@pytest.mark.parametrize(
    ("file", "text", "message"),
    [
        ("detections/C9.txt", "1,-1,1,1,9,9,1,-1,-1,-1\n", r"C9.txt: is of camera 'C9', recording.json has C1, C2"),
        ("detections/C1.txt", "1,-1,1,1,9\n", r"C1.txt:1: 5 values, needs 10"),
        ("truth.txt", "1,3,-1,-1,-1,-1,1,900,100,0\n", r"truth.txt: frame 1, id 3: x, y are \(900, 100\) m, 894 m outside the area"),
        ("truth.txt", "7,3,-1,-1,-1,-1,1,2,1,0\n", r"truth.txt: frame is 7, which no camera has, needs at most 3"),
        ("truth.txt", "1,3,5,5,9,9,1,-1,-1,-1\n", r"truth.txt:1: has no x, y, z"),
        ("robots.json", '{"r0": {}}', r"robots.json: r0: start is missing"),
    ],
)
def test_invalid_files_are_named(tmp_path: Path, file: str, text: str, message: str) -> None:
    write_recording(tmp_path, small())
    (tmp_path / file).write_text(text)
    with pytest.raises(ValueError, match=message):
        open_recording(tmp_path)


def test_frames_that_lie_outside_are_read_by_the_check(tmp_path: Path) -> None:
    write_recording(tmp_path, small())
    (tmp_path / "truth.txt").write_text("7,3,-1,-1,-1,-1,1,900,1,0\n")
    assert read_recording(tmp_path, strict=False).frames == 7


def test_parts_of_a_recording(tmp_path: Path) -> None:
    write_recording(tmp_path, small())
    other = tmp_path / "other"
    other.mkdir()
    (other / "C2.txt").write_text("3,-1,10,10,20,50,0.5,-1,-1,-1\n")
    part = open_recording(tmp_path, SourceOptions.parse([str(other)], cameras="2", frames="1:3"))
    assert list(part.cameras) == ["C2"]
    assert part.frames == 2
    assert list(part.detections["C2"]) == [1]
    options = SourceOptions.parse([f"C2={other / 'C2.txt'}"], cameras="C2", frames="1:")
    again = open_sequence(tmp_path, SourceOptions.of_run(options.to_run()))
    assert [len(tick.views[0].detections) for tick in again.ticks] == [0, 1]
    for options, message in (
        (SourceOptions(("C7",)), "camera is 'C7', needs one of C1, C2"),
        (SourceOptions(frames=(5, 9)), "--frames is 5:9, needs a first frame below 3"),
        (SourceOptions(detections={"C7": other / "C2.txt"}), "camera is 'C7'"),
    ):
        with pytest.raises(ValueError, match=message):
            open_recording(tmp_path, options)
    with pytest.raises(ValueError, match="--frames is '3:2', needs FIRST:END"):
        SourceOptions.parse(frames="3:2")


def test_cameras_without_detections_say_nothing(tmp_path: Path) -> None:
    """An empty view would be evidence that nobody is there."""
    write_recording(tmp_path, replace(small(), detections={"C1": small().detections["C1"]}))
    for options in (None, SourceOptions.parse(degrade="drop=0.5,clutter=1")):
        assert [[view.camera for view in tick.views] for tick in open_sequence(tmp_path, options).ticks] == [["C1"]] * 3
