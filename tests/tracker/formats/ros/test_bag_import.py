"""Bags become recordings: those that rosbags writes in ROS 1, ROS 2 and MCAP, with stamps, mounts, odometry and what is wrong with them."""

import csv
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from tests.tracker import sequences
from tests.tracker.formats.ros.robot_bag import (
    COMPRESSED,
    EPOCH,
    FORMS,
    HEIGHT,
    IMAGE,
    MOUNT,
    WIDTH,
    RobotBag,
    Row,
    image_message,
    jpeg_message,
    pose_at,
    write_bag,
)
from tracker.formats.exporting import export
from tracker.formats.opening import open_sequence
from tracker.formats.ros.bag import message_types
from tracker.formats.ros.bag_import import BagTopics, read_bag
from tracker.formats.ros.bag_reader import bag_text, summarize_bag
from tracker.formats.ros.messages import header
from tracker.formats.source_options import SourceOptions
from tracker.geometry.cameras import Panorama
from tracker.metrics.evaluation import evaluate
from tracker.pipeline import track
from tracker.sequence.reader import read_sequence
from tracker.sequence.results import Results

PANORAMA = BagTopics({"/pano/image_raw": "panorama"}, ("/odom",), ("/imu",))


def times(folder: Path) -> list[tuple[str, int, float]]:
    with (folder / "times.csv").open() as file:
        return [(row["camera"], int(row["frame"]), float(row["time_s"])) for row in csv.DictReader(file)]


@pytest.mark.parametrize("form", FORMS)
def test_a_robot_is_read_from_each_form(tmp_path: Path, form: str) -> None:
    bag = RobotBag().write(tmp_path / "walk", form)
    notes: list[str] = []
    recording = read_bag(bag, PANORAMA, tmp_path / "out", notes.append)
    assert (recording.rate, recording.frames, list(recording.cameras)) == (5.0, 11, ["pano"])
    camera = recording.cameras["pano"]
    assert camera.camera == Panorama(WIDTH, HEIGHT)
    assert camera.robot == "robot"
    assert_allclose((camera.pose.inverse() @ MOUNT).log(), 0, atol=1e-12)
    assert_allclose([time for _, _, time in times(tmp_path / "out")], np.arange(11) / 5, atol=1e-9)
    robot = recording.robots["robot"]
    assert robot.start is not None
    assert_allclose((robot.start.T_world_robot.inverse() @ pose_at(0.013)).log(), 0, atol=1e-4)
    for frame in range(1, 11):
        true = pose_at(frame / 5 - 0.187).inverse() @ pose_at(frame / 5 + 0.013)
        assert_allclose((robot.odometry[frame].T_before_now.inverse() @ true).log(), 0, atol=1e-4)
        up = robot.odometry[frame].gravity
        assert up is not None
        assert_allclose(up, np.array([-0.1, 0, 9.8]) / np.hypot(0.1, 9.8), atol=1e-3)  # turned by the mount of the IMU
    assert notes == ["/odom: states no variance of x, y, z, roll, pitch, yaw; 5 cm and 2 degrees after a metre are taken"]
    images = list(recording.images["pano"].images(11, (HEIGHT, WIDTH)))
    assert [image[0, 0].tolist() for image in images if image is not None] == [[10 * k, 200, 0] for k in range(11)]


def test_info_lists_topics_with_rates_and_gaps(tmp_path: Path) -> None:
    def lose(row: Row) -> Row | None:
        return None if row[0] == "/odom" and 0.5e9 < row[3] - EPOCH < 1.2e9 else row

    found = summarize_bag(RobotBag(change=lose).write(tmp_path / "walk"))
    assert found["topics"]["/odom"] == {"type": "nav_msgs/Odometry", "messages": 29, "rate": 20.0, "gaps": 1, "longest_gap": 0.7}
    assert found["topics"]["/tf_static"]["rate"] is None
    text = bag_text(found).splitlines()
    assert text[0].endswith("walk: ROS 2, 285 messages in 2.050 s from 1700000000.000000000")
    assert "  /odom: nav_msgs/Odometry, 29, 20/s, 1 gap up to 0.700 s" in text


def test_gaps_and_odd_rates_keep_their_times(tmp_path: Path) -> None:
    """Two of eleven images are lost, and the clock of the camera wanders by 20 ms."""

    def change(row: Row) -> Row | None:
        k = round((row[3] - EPOCH) / 2e8)
        if row[0] != "/pano/image_raw":
            return row
        stamp = EPOCH + round(2e8 * k + 2e7 * np.sin(k))
        return None if k in (3, 4) else (*row[:2], row[2] | {"header": header(stamp, "pano_optical")}, row[3])

    read_bag(RobotBag(change=change).write(tmp_path / "walk"), PANORAMA, tmp_path / "out")
    found = times(tmp_path / "out")
    assert [frame for _, frame, _ in found] == [1, 2, 3, 6, 7, 8, 9, 10, 11]
    assert_allclose([time for *_, time in found], [0.2 * (f - 1) + 0.02 * np.sin(f - 1) for _, f, _ in found], atol=1e-6)
    names = sorted(file.name for file in (tmp_path / "out" / "images" / "pano").iterdir())
    assert names == [f"{frame:06d}.png" for _, frame, _ in found]


def test_jpegs_are_copied_as_they_are(tmp_path: Path) -> None:
    def change(row: Row) -> Row:
        stamp = row[3] - 4_000_000
        return ("/pano/compressed", COMPRESSED, jpeg_message(3, stamp), row[3]) if row[0] == "/pano/image_raw" else row

    read_bag(RobotBag(change=change).write(tmp_path / "walk"), BagTopics({"/pano/compressed": "panorama"}, ("/odom",)), tmp_path / "out")
    assert (tmp_path / "out" / "images" / "pano" / "000003.jpg").read_bytes() == jpeg_message(3, 0)["data"]


def _without(*topics: str) -> RobotBag:
    return RobotBag(without=topics)


def _images(change: Callable[[int, Row], Row]) -> RobotBag:
    """A bag with changed images. change: number of the image and its row."""
    return RobotBag(change=lambda row: change(round((row[3] - EPOCH) / 2e8), row) if row[0] == "/pano/image_raw" else row)


def _stamped(k: int, stamp: int) -> RobotBag:
    """Image k has another stamp."""
    return _images(lambda n, row: (*row[:2], image_message(n, stamp), row[3]) if n == k else row)


def _encoded(encoding: str) -> RobotBag:
    return _images(lambda n, row: (*row[:2], image_message(n, row[3] - 4_000_000, encoding if n == 2 else "rgb8"), row[3]))


@pytest.mark.parametrize(
    ("bag", "topics", "message"),
    [
        (RobotBag(), BagTopics(), "needs --camera TOPIC, one or more of /pano/image_raw"),
        (RobotBag(), BagTopics({"/cam": ""}), "has no topic /cam, needs sensor_msgs/Image or .*; there are: /pano/image_raw"),
        (RobotBag(), BagTopics({"/pano/image_raw": "panorama"}, ("/imu",)), "/imu is sensor_msgs/Imu, needs nav_msgs/Odometry; there are: /odom"),
        (RobotBag(), BagTopics({"/pano/image_raw": ""}, ("/odom",)), "/pano/image_raw: has no CameraInfo beside it, needs TOPIC=panorama or"),
        (_without("/tf_static"), PANORAMA, "no transform from its frame 'pano_optical' to base_link, needs --calibration FILE or transforms"),
        (_encoded("bayer_rggb8"), PANORAMA, r"/pano/image_raw at 1700000000\.417000000 s: encoding is 'bayer_rggb8', needs one of bgr8"),
        (_encoded("16UC1"), PANORAMA, r"/pano/image_raw at 1700000000\.417000000 s: encoding is '16UC1', needs one of bgr8"),
    ],
)
def test_what_is_missing_is_asked_for_in_one_line(tmp_path: Path, bag: RobotBag, topics: BagTopics, message: str) -> None:
    path = bag.write(tmp_path / "walk")
    with pytest.raises(ValueError, match=message) as caught:
        read_bag(path, topics, tmp_path / "out")
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("stamp", "why"),
    [
        (0, r"stamp is 0, at 1700000000\.817000000 s of the log"),
        (EPOCH, r"stamp 1700000000\.000000000 comes after 1700000000\.613000000, at 1700000000\.817000000 s of the log"),
    ],
)
def test_stamps_that_do_not_grow_are_left_out(tmp_path: Path, stamp: int, why: str) -> None:
    notes: list[str] = []
    recording = read_bag(_stamped(4, stamp).write(tmp_path / "walk"), PANORAMA, tmp_path / "out", notes.append)
    assert sum(f"/pano/image_raw: left out 1 of 11 messages, the first where {why.replace(chr(92), '')}" == note for note in notes) == 1
    assert [frame for _, frame, _ in times(tmp_path / "out")] == [1, 2, 3, 4, 6, 7, 8, 9, 10, 11]
    assert recording.frames == 11


def test_a_bag_whose_stamps_are_all_0_is_refused(tmp_path: Path) -> None:
    bag = _images(lambda n, row: (*row[:2], image_message(n, 0), row[3])).write(tmp_path / "walk")
    with pytest.raises(ValueError, match=r"/pano/image_raw: stamp is 0, at .*; so are all its 11 messages"):
        read_bag(bag, PANORAMA, tmp_path / "out")


def test_stamps_that_jump_are_refused(tmp_path: Path) -> None:
    bag = _images(lambda n, row: (*row[:2], image_message(n, row[3] if n > 4 else n * 200_000_000 + 1), row[3])).write(tmp_path / "walk")
    with pytest.raises(ValueError, match=r"walk: stamps of images are .* at 5/s \(pano from 0\.0+1 to 1700000002\..*one clock") as caught:
        read_bag(bag, PANORAMA, tmp_path / "out")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("unknown", [np.nan, np.inf])
def test_a_variance_that_is_no_number_is_not_stated(tmp_path: Path, unknown: float) -> None:
    def change(row: Row) -> Row:
        if row[0] != "/odom":
            return row
        covariance = np.diag([1e-4, unknown, unknown, unknown, unknown, 1e-4])
        return (*row[:2], row[2] | {"twist": row[2]["twist"] | {"covariance": covariance.ravel()}}, row[3])

    notes: list[str] = []
    recording = read_bag(RobotBag(change=change).write(tmp_path / "walk"), PANORAMA, tmp_path / "out", notes.append)
    assert "/odom: states no variance of y, z, roll, pitch; 5 cm and 2 degrees after a metre are taken" in notes
    assert recording.robots["robot"].odometry[5].covariance[0, 0] == pytest.approx(1e-4 * 0.05 * 0.2, rel=0.1)


def test_unrelated_cameras_without_odometry_are_robots_of_their_own(tmp_path: Path) -> None:
    names = ("left", "right", "rear")

    def rows() -> list[Row]:
        stamps = [EPOCH + 200_000_000 * k for k in range(3)]
        framed = [(n, stamp, image_message(k, stamp) | {"header": header(stamp, n)}) for k, stamp in enumerate(stamps) for n in names]
        return [(f"/ns/{name}/image_raw", IMAGE, message, stamp) for name, stamp, message in framed]

    bag = write_bag(tmp_path / "walk", "mcap", rows())
    recording = read_bag(bag, BagTopics({f"/ns/{name}/image_raw": "panorama" for name in names}), tmp_path / "out")
    assert len({camera.robot for camera in recording.cameras.values()}) == 3


def test_two_cameras_of_one_frame_are_refused(tmp_path: Path) -> None:
    def double(row: Row) -> Row:
        return ("/second/image_raw", *row[1:]) if row[0] == "/pano/image_raw" and row[3] > EPOCH + 10**9 else row

    bag = RobotBag(change=double).write(tmp_path / "walk")
    with pytest.raises(ValueError, match="cameras /pano/image_raw and /second/image_raw have one frame id 'pano_optical'"):
        read_bag(bag, BagTopics({"/pano/image_raw": "panorama", "/second/image_raw": "panorama"}, ("/odom",)), tmp_path / "out")


def test_a_calibration_file_stands_in_for_transforms(tmp_path: Path) -> None:
    file = tmp_path / "cameras.json"
    R = [[0, -1, 0], [0, 0, -1], [1, 0, 0]]
    file.write_text(f'{{"pano": {{"model": "equirectangular", "width": 64, "height": 32, "R": {R}, "t": [0, 0.8, 0], "robot": "robot"}}}}')
    topics = BagTopics({"/pano/image_raw": ""}, ("/odom",), calibration=file)
    recording = read_bag(_without("/tf_static").write(tmp_path / "walk"), topics, tmp_path / "out")
    assert_allclose(recording.cameras["pano"].pose.log(), [0, 0, 0.8, 0, 0, 0], atol=1e-12)


def test_without_rosbags_one_line_says_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    bag = RobotBag().write(tmp_path / "walk")
    message_types.cache_clear()
    monkeypatch.setitem(sys.modules, "rosbags.typesys", None)
    with pytest.raises(ValueError, match=r"bags need rosbags: pip install 'pilsim\[ros\]'"):
        summarize_bag(bag)


@pytest.fixture(scope="module")
def again(exported: Callable[[str], Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The recording of the bag of the plaza."""
    bag, out = exported("mcap") / "plaza", tmp_path_factory.mktemp("again") / "plaza"
    read_bag(bag, BagTopics.of_export(bag), out)
    return out


def test_our_own_export_is_tracked_and_scored_as_the_sequence(sequence: Path, again: Path) -> None:
    """The same ids, places to 1 mm, and the same scores, of people and of the robot."""
    one, other = read_sequence(sequence), open_sequence(again)
    tracked, retracked = (Results.of(track(s.setup, s.ticks), run={}) for s in (one, other))
    assert sum(len(ids) for ids, _ in tracked.tracks.values()) >= 6
    for frame, (ids, places) in tracked.tracks.items():
        assert_array_equal(retracked.tracks[frame][0], ids)
        assert_allclose(retracked.tracks[frame][1], places, atol=1e-3)
    scores, rescored = evaluate(one, tracked), evaluate(other, retracked)
    assert rescored["targets"] == pytest.approx(scores["targets"], abs=1e-3)
    assert rescored["robots"]["ate_m"] == pytest.approx(scores["robots"]["ate_m"], abs=1e-3)
    for s, t in zip(one.truth or (), other.truth or (), strict=True):
        assert_array_equal(s.person_id, t.person_id)
        assert_allclose(s.visible.max(axis=1), t.visible.max(axis=1), atol=1e-6)


def test_pictures_and_odometry_of_our_own_export_alone(sequence: Path, exported: Callable[[str], Path], tmp_path: Path) -> None:
    """As the sequence without its boxes and terrain: the same images, odometry, mounts and start; no truth is read."""
    topics = BagTopics({"/robot_0_camera/image/compressed": "", "/view_1/image/compressed": "pinhole"}, ("/robot_0/odom",), ("/robot_0/up",))
    recording = read_bag(exported("mcap") / "plaza", topics, tmp_path / "out")
    assert recording.truth is None
    assert recording.robots["robot_0"].truth is None
    one, other = read_sequence(sequence), recording.sequence(images=True)
    assert list(other.setup.mounts) == ["robot_0_camera", "view_1"]
    start, expected = other.setup.starts["robot_0"], one.setup.starts["robot_0"]
    assert start is not None
    assert expected is not None
    assert_allclose((start.T_world_robot.inverse() @ expected.T_world_robot).log(), 0, atol=1e-9)
    for a, b in zip(one.ticks, other.ticks, strict=True):
        for v in b.views:
            w = next(w for w in a.views if w.camera == v.camera)
            assert v.image is not None
            assert_array_equal(v.image, w.image)
            assert (v.odometry is None) == (w.odometry is None)
            if v.odometry is not None and w.odometry is not None:
                assert_allclose((v.odometry.T_before_now.inverse() @ w.odometry.T_before_now).log(), 0, atol=1e-9)
                assert_allclose(v.odometry.covariance, w.odometry.covariance, rtol=1e-6, atol=1e-15)
                assert_allclose(v.odometry.gravity, w.odometry.gravity, atol=1e-9)


def test_another_bag_is_no_export(tmp_path: Path) -> None:
    bag = RobotBag().write(tmp_path / "walk")
    with pytest.raises(ValueError, match="has no /truth/people and /CAMERA/camera_info, needs a bag of `pilsim export --format mcap`"):
        BagTopics.of_export(bag)


def test_a_robot_without_odometry_is_said(tmp_path: Path) -> None:
    notes: list[str] = []
    bag = RobotBag().write(tmp_path / "walk")
    recording = read_bag(bag, BagTopics({"/pano/image_raw": "panorama"}), tmp_path / "out", notes.append)
    assert recording.cameras["pano"].robot == "robot"
    assert recording.robots["robot"].odometry == {}
    assert notes == ["robot: no odometry, so that motion is predicted at constant velocity and lengths have no scale"]
    sequence = recording.sequence()
    last = list(track(sequence.setup, sequence.ticks))[-1]
    assert last.counters["constant velocity"] == 10
    assert last.T_world_robot["robot"].translation[0] > 0.3


@pytest.mark.parametrize("form", ["mcap", "recording"])
def test_robots_that_see_each_other_and_covariances_are_kept(tmp_path: Path, form: str) -> None:
    """Through a bag, and through a recording; two robots of which only the views know each other."""
    sequences.write(tmp_path / "pair")
    export(tmp_path / "pair", form, tmp_path / "out")
    folder = tmp_path / "out" / "pair"
    if form == "mcap":
        read_bag(folder, BagTopics.of_export(folder), tmp_path / "again")
        folder = tmp_path / "again"
    one, other = read_sequence(tmp_path / "pair"), open_sequence(folder)
    for a, b in zip(one.ticks, other.ticks, strict=True):
        for v, w in zip(a.views, b.views, strict=True):
            assert v.robot_detections is not None
            assert w.robot_detections is not None
            assert v.robot_detections.robot == w.robot_detections.robot
            assert_allclose(v.robot_detections.bearing, w.robot_detections.bearing, atol=1e-12)
            assert_allclose(v.robot_detections.covariance, w.robot_detections.covariance, atol=1e-18)
            assert_allclose(v.detections.bearing, w.detections.bearing, atol=1e-9)
            assert_allclose(v.detections.covariance, w.detections.covariance, atol=1e-15)
    only = open_sequence(folder, SourceOptions.parse(cameras="robot_1_camera"))
    assert all(not view.robot_detections for tick in only.ticks for view in tick.views)
