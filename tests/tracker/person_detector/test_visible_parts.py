"""Visible parts of boxes: what is found, written, read and used of them."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.tracker.disc_sequence import write as write_sequence
from tests.tracker.person_detector.blob_network import picture_with, write_blob_network
from tests.tracker.recordings.test_folder import small
from tracker.formats.opening import open_sequence
from tracker.formats.source_options import SourceOptions
from tracker.geometry import Array
from tracker.geometry.cameras import Pinhole
from tracker.io.mot15 import read_mot15, rows_from_boxes, write_mot15
from tracker.metrics.box_detection import count_boxes, judge
from tracker.metrics.scored_images import images_of
from tracker.person_detector.detection_run import DetectionRun, write_detections
from tracker.person_detector.detector import CameraPlace, PersonDetector
from tracker.person_detector.pictures import PictureFrame
from tracker.recordings.folder import read_recording, write_recording
from tracker.sequence.truth_tables import read_boxes


def test_both_extents_are_written(tmp_path: Path) -> None:
    """Boxes of 20 x 94 px of which the upper half is visible, but for a tenth at each side; one is cut off by the image border at 160 px."""
    detector = PersonDetector(write_blob_network(tmp_path / "m.onnx", hidden=(0.1, 1e-4, 0.1, 0.5)))
    frame = PictureFrame(0, "C1", picture_with((160, 128), [(40.0, 58.0), (90.0, 142.0)]), CameraPlace())
    for visible in (False, True):
        out = tmp_path / str(visible)
        write_detections([frame], 1, out, {}, DetectionRun(detector, visible=visible))
        boxes, parts = read_mot15(out / "C1.txt"), read_mot15(out / "C1.visible.txt")
        order = np.argsort(boxes.box[:, 0])
        np.testing.assert_allclose(parts.box[order], [[32, 11, 16, 47], [82, 95, 16, 47]], atol=2.0)
        # Of the second box, 65 px are in the image, and 47 of them visible.
        np.testing.assert_allclose(parts.confidence[order], [0.8 * 0.5, 0.8 * 47 / 65], atol=0.03)
        assert (boxes.box == parts.box).all() == visible
        with pytest.raises(ValueError, match="holds another run"):
            write_detections([frame], 1, out, {}, DetectionRun(detector, visible=not visible))


def test_boxes_of_a_model_without_visible_parts_are_wholly_visible(tmp_path: Path) -> None:
    found = PersonDetector(write_blob_network(tmp_path / "m.onnx")).find(picture_with((128, 128), [(40.0, 60.0)]))
    np.testing.assert_array_equal(found.visible, np.column_stack([found.box, np.ones(len(found))]))
    assert len(found) == 1


def test_the_feet_of_found_people_are_seen_where_the_visible_part_reaches_them(tmp_path: Path) -> None:
    picture, site = picture_with((128, 256), [(60.0, 60.0)]), CameraPlace(Pinhole(256, 128, 200.0, 200.0, 128.0, 64.0))
    for below, seen in ((0.02, True), (0.4, False)):
        detector = PersonDetector(write_blob_network(tmp_path / "m.onnx", hidden=(0.01, 0.01, 0.01, below)))
        assert detector.detections(picture, site).feet_seen.tolist() == [seen]


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
