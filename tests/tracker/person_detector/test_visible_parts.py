"""Visible parts: what nearer people cover, its share and its box, across the seam, and what is written, read and used of it."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.tracker.disc_sequence import write as write_sequence
from tests.tracker.person_detector.blob_network import BLOB, picture_with, write_blob_network
from tests.tracker.recordings.test_folder import small
from tracker.formats.opening import open_sequence
from tracker.formats.source_options import SourceOptions
from tracker.geometry import Array
from tracker.io.mot15 import read_mot15, rows_from_boxes, write_mot15
from tracker.metrics.box_detection import count_boxes, judge
from tracker.metrics.scored_images import images_of
from tracker.person_detector.detection_run import DetectionRun, write_detections
from tracker.person_detector.detector import CameraPlace, PersonDetector
from tracker.person_detector.pictures import PictureFrame
from tracker.person_detector.visible_parts import BODY, visible_parts
from tracker.recordings.folder import read_recording, write_recording
from tracker.sequence.truth_tables import read_boxes

FAR, NEAR = [100.0, 50.0, 40.0, 100.0], [90.0, 90.0, 60.0, 150.0]


def test_who_has_lower_feet_covers_who_has_higher_ones() -> None:
    """The nearer body is 30 px wide about the same middle, and begins 40 px below the farther head."""
    box, share = visible_parts(np.array([FAR, NEAR]), np.ones(2), None)
    np.testing.assert_allclose(share, [0.4, 1.0], atol=0.02)
    np.testing.assert_array_equal(box[1], NEAR)
    # Beside the nearer body, 5 px on each side are open down to the feet.
    np.testing.assert_array_equal(box[0], FAR)
    wider, _ = visible_parts(np.array([FAR, [70.0, 90.0, 100.0, 150.0]]), np.ones(2), None)
    np.testing.assert_allclose(wider[0], [100, 50, 40, 40], atol=2)
    box, share = visible_parts(np.array([FAR, [70.0, 40.0, 100.0, 150.0]]), np.ones(2), None)
    assert share[0] == 0
    np.testing.assert_array_equal(box[0], FAR)


def test_shares_fall_with_the_probability_of_what_covers_and_have_no_seam() -> None:
    rng, width = np.random.default_rng(0), 400.0
    box = np.column_stack([rng.uniform(0, width, 30), rng.uniform(0, 100, 30), rng.uniform(20, 60, 30), rng.uniform(50, 150, 30)])
    (parts, *_), (sure, unsure, nothing) = zip(*(visible_parts(box, np.full(30, p), width) for p in (1.0, 0.5, 0.0)), strict=True)
    assert (sure <= unsure + 1e-12).all()
    assert (unsure <= nothing).all()
    assert (nothing == 1).all()
    assert sure.min() < 0.3
    moved = np.column_stack([(box[:, 0] + 123) % width, box[:, 1:]])
    np.testing.assert_allclose(visible_parts(moved, np.ones(30), width)[1], sure, atol=0.05)
    inside = np.concatenate([parts[:, :2] - box[:, :2], (box - parts)[:, :2] + (box - parts)[:, 2:]], axis=1)
    assert (inside >= -1e-9).all()
    assert 0 < BODY < 1


def test_both_extents_are_written(tmp_path: Path) -> None:
    """A box of 20 x 70 px, and one twice as large whose body covers its lower part."""
    detector = PersonDetector(write_blob_network(tmp_path / "m.onnx"))
    image = np.maximum(picture_with((256, 128), [(50.0, 46.0)]), picture_with((256, 128), [(50.0, 132.0)], 2 * BLOB))
    frame = PictureFrame(0, "C1", image, CameraPlace())
    for visible in (False, True):
        out = tmp_path / str(visible)
        write_detections([frame], 1, out, {}, DetectionRun(detector, visible=visible))
        boxes, parts = read_mot15(out / "C1.txt"), read_mot15(out / "C1.visible.txt")
        upper = int(np.argmin(boxes.box[:, 1]))
        assert len(boxes) == len(parts)
        assert parts.confidence[upper] == pytest.approx(51 / 70, abs=0.03)
        # Two pixels at its left side are open down to the feet.
        np.testing.assert_array_equal(parts.box[upper], boxes.box[upper])
        assert parts.confidence[np.argmax(boxes.box[:, 1] + boxes.box[:, 3])] == 1
        assert (boxes.box == parts.box).all() == visible
        with pytest.raises(ValueError, match="holds another run"):
            write_detections([frame], 1, out, {}, DetectionRun(detector, visible=not visible))


def write_found(folder: Path, boxes: Mapping[tuple[int, str], Array], statement: str) -> None:
    folder.mkdir()
    for name in {camera for _, camera in boxes}:
        own = {frame + 1: edges for (frame, camera), edges in boxes.items() if camera == name}
        found = {frame: (np.column_stack([b[:, :2], b[:, 2:] - b[:, :2]]), np.ones(len(b))) for frame, b in own.items()}
        write_mot15(folder / f"{name}.txt", rows_from_boxes(found))
    (folder / "run.json").write_text(statement)


def test_visible_boxes_are_scored_against_visible_parts(tmp_path: Path) -> None:
    write_sequence(tmp_path / "s")
    true = {key: boxes.seen[boxes.visible > 0] for key, boxes in read_boxes(tmp_path / "s").items()}
    for kind in ("visible", None):
        write_found(tmp_path / str(kind), true, json.dumps({"boxes": kind}))
    visible, whole = (images_of(tmp_path / "s", tmp_path / kind, SourceOptions.parse()) for kind in ("visible", "None"))
    assert judge(visible)[0].average_precision() == 1
    assert count_boxes(visible, 0.5).modp() == pytest.approx(1.0)
    assert all(((a.truth == b.truth).all(axis=1) | (a.visible < 1)).all() for a, b in zip(visible, whole, strict=True))


def test_recordings_have_visible_parts_and_the_tracker_takes_no_hidden_feet(tmp_path: Path) -> None:
    recording = small()
    boxes = {frame: box for frame, (box, _) in recording.detections["C1"].items()}
    parts = {frame: np.column_stack([box, np.ones(len(box))]) for frame, box in boxes.items()}
    parts[2][0, 3] /= 2
    write_recording(tmp_path, replace(recording, visible_parts={"C1": parts}))
    again = read_recording(tmp_path)
    for frame, of_frame in parts.items():
        np.testing.assert_array_equal(again.visible_parts["C1"][frame], of_frame)
    seen = {tick.index: tick.views[0].detections.feet_seen.tolist() for tick in again.sequence().ticks}
    assert seen[0] == [True]
    assert seen[2] == [False, True]
    assert not again.with_detections({"C1": again.detections["C1"]}).visible_parts
    other = open_sequence(tmp_path, SourceOptions.parse([f"{tmp_path}/detections"]))
    assert {t.index: t.views[0].detections.feet_seen.tolist() for t in other.ticks} == seen


@pytest.mark.parametrize(("change", "message"), [("1,-1,1,1,1,1,2,-1,-1,-1\n", "share that is not in"), ("", "frame 1 has 0 rows, needs 1")])
def test_other_rows_are_refused_in_a_line(tmp_path: Path, change: str, message: str) -> None:
    write_recording(tmp_path, small())
    (tmp_path / "detections" / "C1.visible.txt").write_text(change)
    with pytest.raises(ValueError, match=message):
        read_recording(tmp_path)
