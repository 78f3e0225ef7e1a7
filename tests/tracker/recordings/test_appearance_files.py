"""Appearance vectors of a recording: read back as written, checked, and used by the tracker."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.benchmarks.room import room
from tests.tracker.recordings.test_folder import small
from tracker.geometry import Array
from tracker.geometry.cameras import Pinhole
from tracker.metrics.evaluation import evaluate
from tracker.pipeline import Parameters, track
from tracker.recordings import Recording, RecordingCamera
from tracker.recordings.folder import read_recording, write_recording
from tracker.sequence.results import Results

VECTORS = {0: np.array([[1.0, 0.5, 0.0]]), 2: np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 2.0]])}


def with_vectors() -> Recording:
    return replace(small(), appearances={"C1": VECTORS})


def test_vectors_are_read_as_written_and_reach_the_tracker(tmp_path: Path) -> None:
    write_recording(tmp_path, with_vectors())
    again = read_recording(tmp_path)
    assert sorted(again.appearances) == ["C1"]
    for frame, vectors in VECTORS.items():
        np.testing.assert_array_equal(again.appearances["C1"][frame], vectors)
    views = [[view.detections.appearance.shape for view in tick.views] for tick in again.sequence().ticks]
    assert views == [[(1, 3), (0, 0)], [(0, 0), (0, 0)], [(2, 3), (0, 0)]]
    cut = again.cut(1, 3).choose(["C1"])
    assert {frame: vectors.shape for frame, vectors in cut.appearances["C1"].items()} == {1: (2, 3)}
    assert not again.with_detections({"C1": again.detections["C1"]}).appearances


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (np.zeros((2, 4)), "has 2 rows, needs 3, one for each different row of C1.txt"),
        (np.zeros(3), "has shape (3,) of float64, needs (rows, d)"),
        (np.zeros((3, 4), dtype=np.int64), "of int64, needs (rows, d) of floating-point numbers"),
        (np.array([[1.0], [np.nan], [0.0]]), "row 1 from 0 has a number that is not finite"),
        (np.array([[None]] * 3), "is not an array of NumPy"),
        (b"", "is not an array of NumPy"),
        (b"\x93NUMPY\x01\x00\xff\xff{'descr': '<f8'", "is not an array of NumPy"),
    ],
)
def test_bad_vectors_are_refused_in_a_line(tmp_path: Path, content: Array | bytes, message: str) -> None:
    write_recording(tmp_path, small())
    file = tmp_path / "detections" / "C1.npy"
    if isinstance(content, bytes):
        file.write_bytes(content)
    else:
        np.save(file, content, allow_pickle=True)
    with pytest.raises(ValueError, match=r"C1\.npy: ") as error:
        read_recording(tmp_path)
    assert message in str(error.value)


def test_a_repeated_box_is_written_once_with_its_vectors(tmp_path: Path) -> None:
    recording = small()
    boxes = {f: (np.repeat(box, 2, axis=0), np.repeat(confidence, 2)) for f, (box, confidence) in recording.detections["C1"].items()}
    twice = {frame: np.repeat(vectors, 2, axis=0) for frame, vectors in VECTORS.items()}
    write_recording(tmp_path, replace(recording, detections={**recording.detections, "C1": boxes}, appearances={"C1": twice}))
    again = read_recording(tmp_path)
    for frame, vectors in VECTORS.items():
        np.testing.assert_array_equal(again.appearances["C1"][frame], vectors)
        np.testing.assert_array_equal(again.detections["C1"][frame][0], recording.detections["C1"][frame][0])


def test_vectors_of_another_number_than_boxes_are_refused() -> None:
    with pytest.raises(ValueError, match=r"appearances of C1, frame 0, have shape \(2, 3\), needs \(1, d\)"):
        replace(small(), appearances={"C1": {0: np.ones((2, 3))}})
    with pytest.raises(ValueError, match=r"covariances of C1, frame 0, have shape \(1, 4\), needs \(1, 3\)"):
        replace(small(), covariances={"C1": {0: np.ones((1, 4))}})


def meeting(vectors: bool) -> Recording:
    """Two people walk to and fro before a camera. They meet behind a pillar, where nobody is seen for a second, and turn back."""
    lens, rate = Pinhole(1280, 720, 640.0, 640.0, 639.5, 359.5), 10.0
    camera = RecordingCamera.looking_at(lens, (0.0, -8.0, 3.0), (0.0, 0.0, 1.0))
    rng, boxes, looks, truth = np.random.default_rng(0), {}, {}, {}
    R, t = camera.opencv_extrinsics
    for frame in range(200):
        # A triangle wave: at 0 after 5, 10, 15 s.
        away = 0.25 + 0.8 * abs((frame / rate) % 5.0 - 2.5) * 1.2
        places = np.array([[-away, 0.0, 0.0], [away, 0.0, 0.0]])
        truth[frame] = np.array([1, 2]), places
        foot, head = ((places + np.array([0.0, 0.0, up])) @ R.T + t for up in (0.0, 1.7))
        u, v, top = 640.0 * foot[:, 0] / foot[:, 2] + 639.5, 640.0 * foot[:, 1] / foot[:, 2] + 359.5, 640.0 * head[:, 1] / head[:, 2] + 359.5
        height = v - top
        box = np.column_stack([u - 0.15 * height, top, 0.3 * height, height]) + rng.normal(0.0, 1.0, (2, 4))
        seen = away > 0.8
        order = rng.permutation(2)
        boxes[frame] = (box[order], np.full(2, 0.9)) if seen else (np.zeros((0, 4)), np.zeros(0))
        looks[frame] = (np.eye(2, 16)[order] * 5 + 1 + 0.4 * rng.normal(size=(2, 16))) if seen else np.zeros((0, 16))
    return Recording(rate, {"C": camera}, {"C": boxes}, truth, appearances={"C": looks} if vectors else {})


def test_vectors_tell_apart_people_who_meet_unseen() -> None:
    """Motion alone says that both walk on. The vectors say that both turn back."""
    found = {}
    for vectors in (False, True):
        sequence = meeting(vectors).sequence()
        found[vectors] = evaluate(sequence, Results.of(track(sequence.setup, sequence.ticks, Parameters()), {}))["targets"]
    assert found[False]["idf1"] < 0.75
    assert found[True]["idf1"] > found[False]["idf1"] + 0.15


@pytest.mark.soak
def test_vectors_help_in_crowded_rooms() -> None:
    """Three synthetic rooms of 15 people whose vectors have a cosine of about 0.7 with others of the same person, and 0.4 with those of other people.

    IDF1 of a single room is uncertain by 0.05.
    """
    found: dict[bool, list[list[float]]] = {False: [], True: []}
    for seed in range(3):
        recording = room(seed)
        for given, appearances in ((False, {}), (True, vectors_of(recording))):
            sequence = replace(recording, appearances=appearances).sequence()
            scores = evaluate(sequence, Results.of(track(sequence.setup, sequence.ticks, Parameters(delay=5)), {}))["targets"]
            found[given].append([scores["mota"], scores["idf1"]])
    mota, idf1 = np.mean(found[True], axis=0) - np.mean(found[False], axis=0)
    assert mota > -0.01
    assert idf1 > 0.05


def vectors_of(recording: Recording) -> dict[str, dict[int, Array]]:
    """Appearance vectors of the boxes of a room of 15 people: each box shows the person whose feet are nearest to its lower edge."""
    rng, truth = np.random.default_rng(0), recording.truth
    assert truth is not None
    own = rng.normal(size=(16, 32))
    vectors: dict[str, dict[int, Array]] = {}
    for name, camera in recording.cameras.items():
        R, t = camera.opencv_extrinsics
        vectors[name] = {}
        for frame, (box, _) in recording.detections[name].items():
            ids, places = truth[frame]
            x = places @ R.T + t
            pixel = 960.0 * x[:, :2] / x[:, 2:] + [959.5, 539.5]
            away = np.linalg.norm(pixel[None] - (box[:, None, :2] + [0.5, 1.0] * box[:, None, 2:]), axis=2)
            nearest = np.argmin(np.where(x[:, 2] > 0, away, np.inf), axis=1)
            person = np.where(away[np.arange(len(box)), nearest] < 0.5 * box[:, 3], ids[nearest], 0)
            vectors[name][frame] = 0.8 + own[person] + 0.8 * rng.normal(size=(len(box), 32))
    return vectors
