"""JRDB as recordings: real labels, the geometry of the panorama, frames and names of sequences, and invalid content."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from tests.tracker.formats.jrdb.cafe import SEQUENCE, write_cafe
from tracker.formats.jrdb.files import DETECTIONS, LABELS_2D, LABELS_3D, read_detections_2d, write_detections_2d
from tracker.formats.jrdb.reading import CAMERA, CYLINDER, is_jrdb, read_jrdb
from tracker.formats.opening import open_recording
from tracker.formats.source_options import SourceOptions
from tracker.metrics.evaluation import evaluate
from tracker.options import parameters_from
from tracker.pipeline import track
from tracker.recordings.degradation import BoxNoise
from tracker.sequence.results import Results

Data = Callable[..., Path]
TABLE = """\
6,3,2.0,0.0,1.4,0.5,0.8,0.1,1830,250,100,200
6,4,0.0,-3.0,1.7,0.5,0.6,0.2,2770,100,100,271
12,3,2.0,0.1,1.4,0.5,0.8,0.1,1800,250,100,200
24,4,-2.5,0.0,1.7,0.5,0.6,0.2,3700,100,100,303
"""
"""Frames 6, 12 and 24: every 6th is labelled, and 18 has nobody."""


@pytest.fixture
def cafe(tmp_path: Path) -> Path:
    (tmp_path / "table.csv").write_text(TABLE)
    write_cafe(tmp_path / "table.csv", tmp_path / "jrdb")
    return tmp_path / "jrdb"


def test_frames_places_and_boxes(cafe: Path) -> None:
    assert is_jrdb(cafe)
    recording = read_jrdb(cafe, labels_as_detections=True)
    assert (recording.rate, recording.frames, recording.height) == (2.5, 4, (0.9, 2.3))
    truth, boxes = recording.truth or {}, recording.detections[CAMERA]
    assert sorted(truth) == sorted(boxes) == [0, 1, 3]
    assert_array_equal(truth[0][0], [3, 4])
    assert_allclose(truth[0][1], [[2, 0, 0], [0, -3, 0]])
    assert_array_equal(boxes[3][0], [[3700, 100, 100, 303]])
    # Without labels as detections, and without detections, the source opens and can be scored.
    assert read_jrdb(cafe).detections == {}


def test_images_have_the_times_of_the_data_set(cafe: Path) -> None:
    file = cafe / "timestamps" / SEQUENCE / "frames_img.json"
    file.parent.mkdir(parents=True)

    def write(times: dict[int, float | str]) -> None:
        other = {"name": "image_0", "url": "x/000000.jpg", "timestamp": 0.0}
        seen = [{"name": "stitched_image0", "url": f"images/{SEQUENCE}/{n:06d}.jpg", "timestamp": t} for n, t in times.items()]
        rows = [{"cameras": [other, one]} for one in seen]
        file.write_text(json.dumps({"data": rows}))

    write({n: str(1.55e9 + n / 15 + 0.02 * (n == 12)) for n in range(30)})
    ticks = list(read_jrdb(cafe, labels_as_detections=True).sequence().ticks)
    assert_allclose([tick.time for tick in ticks], [0.0, 0.42, 0.8, 1.2], atol=1e-5)
    for times, words in (({6: 1.0, 12: 2.0}, "has no time of image 000018"), ({6: 1.0, 12: 2.0, 18: 2.0, 24: 3.0}, "growing with the frames")):
        write(times)
        with pytest.raises(ValueError, match=words):
            read_jrdb(cafe)


def test_feet_on_the_floor_are_where_the_panorama_has_them(cafe: Path) -> None:
    """v = 210.7 + 481 / range, azimuth = π − 2πu/3760; a body of height h at range r has 481 h / r rows."""
    camera = read_jrdb(cafe).cameras[CAMERA]
    feet = np.array([[2.0, 0.0, 0.0], [0.0, -3.0, 0.0], [-4.0, 0.001, 0.0], [1.0, 1.0, 0.0]])
    for height in (0.0, 1.3):
        rays = camera.pose.inverse().apply(feet + np.array([0.0, 0.0, height]))
        pixels, _ = camera.camera.pixels_from_bearings(rays / np.linalg.norm(rays, axis=1, keepdims=True))
        distance = np.hypot(feet[:, 0], feet[:, 1])
        assert_allclose(pixels[:, 1], 210.7 + 481 * (1 - height) / distance)
        assert_allclose(pixels[:, 0], (np.pi - np.arctan2(feet[:, 1], feet[:, 0])) * 3760 / (2 * np.pi))
    assert camera.camera == CYLINDER


def test_detections_of_jrdb_and_of_a_text_file(cafe: Path) -> None:
    (cafe / DETECTIONS).mkdir(parents=True)
    found = {
        6: (np.array([[10.0, 20, 30, 40], [3700, 100, 100, 300]]), np.array([0.9, 2.5])),
        9: (np.zeros((1, 4)), np.ones(1)),
        24: (np.zeros((0, 4)), np.zeros(0)),
    }
    write_detections_2d(cafe / DETECTIONS / f"{SEQUENCE}.json", found)
    again = read_detections_2d(cafe / DETECTIONS / f"{SEQUENCE}.json")
    assert list(again) == [6, 9, 24]
    for frame, (boxes, scores) in found.items():
        assert_array_equal(again[frame][0], boxes)
        assert_array_equal(again[frame][1], scores)
    # Frame 9 lies between the labelled ones.
    assert sorted(read_jrdb(cafe).detections[CAMERA]) == [0, 3]
    # What other classes a detector reports is left out.
    content = json.loads((cafe / DETECTIONS / f"{SEQUENCE}.json").read_text())
    content["detections"]["000006.jpg"][0]["label_id"] = "dog:1"
    (cafe / DETECTIONS / f"{SEQUENCE}.json").write_text(json.dumps(content))
    assert len(read_jrdb(cafe).detections[CAMERA][0][0]) == 1
    (cafe / "detections" / f"{SEQUENCE}.txt").write_text("2,-1,10,20,30,40,0.7,-1,-1,-1\n")
    assert_array_equal(read_jrdb(cafe).detections[CAMERA][1][0], [[10, 20, 30, 40]])


def test_one_of_several_sequences_is_named_by_its_labels(cafe: Path) -> None:
    first = cafe / LABELS_3D / f"{SEQUENCE}.json"
    shutil.copy(first, cafe / LABELS_3D / "other.json")
    with pytest.raises(ValueError, match=rf"holds 2 sequences \({SEQUENCE}, other\) of JRDB, needs one; name it by its file of labels"):
        read_jrdb(cafe)
    assert is_jrdb(first)
    assert read_jrdb(first).source["sequence"] == SEQUENCE
    assert read_jrdb(cafe / LABELS_2D / f"{SEQUENCE}.json").frames == 4
    assert read_jrdb(cafe / LABELS_3D / "other.json").source["sequence"] == "other"


def test_labels_without_the_folder_above(cafe: Path) -> None:
    for folder in ("labels_3d", "labels_2d_stitched"):
        shutil.move(cafe / "labels" / folder, cafe / folder)
    assert is_jrdb(cafe)
    assert read_jrdb(cafe).frames == read_jrdb(cafe / "labels_3d" / f"{SEQUENCE}.json").frames == 4


def broken(folder: str, old: str, new: str) -> Callable[[Path], object]:
    def change(root: Path) -> None:
        file = root / folder / f"{SEQUENCE}.json"
        assert old in file.read_text()
        file.write_text(file.read_text().replace(old, new, 1))

    return change


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (broken(LABELS_3D, '"cx": 2.0', '"cx": "left"'), r"labels_3d/.*json: labels: 000006\.pcd\[0\]: box: cx is 'left', needs a number"),
        (broken(LABELS_3D, '"cx": 2.0, ', ""), r"labels_3d/.*json: .*box: cx is missing"),
        (broken(LABELS_3D, "000006.pcd", "six.pcd"), r"labels of 'six\.pcd', needs NUMBER\.pcd"),
        (broken(LABELS_3D, "000024.pcd", "99000024.pcd"), r"needs less than 200000"),
        (broken(LABELS_2D, "pedestrian:3", "cyclist:3"), r"label_id is 'cyclist:3', needs pedestrian:NUMBER"),
        (lambda root: shutil.rmtree(root / "labels"), r"holds no sequence of JRDB"),
    ],
)
def test_invalid_content_is_named(cafe: Path, change: Callable[[Path], object], message: str) -> None:
    change(cafe)
    with pytest.raises(ValueError, match=message):
        read_jrdb(cafe)


def test_images_of_another_size_are_refused(cafe: Path) -> None:
    folder = cafe / "images" / "image_stitched" / SEQUENCE
    folder.mkdir(parents=True)
    for frame in (6, 9, 24):
        cv2.imwrite(str(folder / f"{frame:06d}.jpg"), np.zeros((480, 3760, 3), dtype=np.uint8))
    images = list(read_jrdb(folder).images[CAMERA].images(4, (480, 3760)))
    assert [image is not None for image in images] == [True, False, False, True]
    cv2.imwrite(str(folder / "000006.jpg"), np.zeros((480, 3000, 3), dtype=np.uint8))
    with pytest.raises(ValueError, match=r"000006\.jpg: is 3000 x 480 px, needs 3760 x 480 px"):
        read_jrdb(cafe)


def test_people_in_a_cafe_are_tracked_in_the_robots_frame(data: Data, tmp_path: Path) -> None:
    """Labels as detections, misses 0.1, edges 2 %, seed 0. A camera 1 m high sees the range of people at more than 5 m to 1 m at best."""
    write_cafe(data("jrdb", f"{SEQUENCE}.csv"), tmp_path)
    recording = read_jrdb(tmp_path, labels_as_detections=True)
    assert (recording.rate, recording.frames) == (2.5, 144)
    boxes = BoxNoise(0.1, 0.02).apply(recording.detections[CAMERA], CYLINDER, np.random.default_rng(0))
    sequence = recording.with_detections({CAMERA: boxes}).sequence()
    estimates = track(sequence.setup, sequence.ticks, parameters_from({"delay": 5}))
    scores = evaluate(sequence, Results.of(estimates, run={}))["targets"]
    assert scores["truths"] == 3347
    assert scores["mota"] > 0.42
    assert scores["idf1"] > 0.45


def test_projected_boxes_are_the_labelled_ones(cafe: Path) -> None:
    """`--project`: people sit, so that upright bodies of one height are not what a detector would see."""
    options = SourceOptions.parse(project="misses=0,edges=0")
    for path in (cafe, cafe / LABELS_3D / f"{SEQUENCE}.json"):
        found = open_recording(path, options).detections[CAMERA]
        assert_array_equal(found[0][0], [[1830, 250, 100, 200], [2770, 100, 100, 271]])
    dropped = open_recording(cafe, SourceOptions.parse(project="misses=1"))
    assert sum(len(boxes) for boxes, _ in dropped.detections[CAMERA].values()) == 0
