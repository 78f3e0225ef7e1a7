"""WILDTRACK export: OpenCV reads the calibrations, and true feet project onto the boxes."""

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from tests.tracker.formats.scene import FRAMES
from tests.tracker.formats.wildtrack.test_rectangles import read_rectangles
from tracker.formats.exported_sequence import RecordedSequence
from tracker.formats.exporting import ExportOptions, export
from tracker.formats.wildtrack.files import HIDDEN, read_ground_grid, read_positions
from tracker.formats.wildtrack.reading import read_wildtrack
from tracker.sequence.reader import read_sequence
from tracker.sequence.truth_tables import read_boxes

Exported = Callable[[str], Path]


def test_feet_project_onto_the_boxes_with_opencv(sequence: Path, exported: Exported) -> None:
    root = exported("wildtrack") / "plaza"
    checked = 0
    for view in range(3):
        storage = cv2.FileStorage(str(root / "calibrations" / "intrinsic" / f"intr_Camera{view + 1}.xml"), cv2.FILE_STORAGE_READ)
        matrix, distortion = storage.getNode("camera_matrix").mat(), storage.getNode("distortion_coefficients").mat()
        storage.release()
        storage = cv2.FileStorage(str(root / "calibrations" / "extrinsic" / f"extr_Camera{view + 1}.xml"), cv2.FILE_STORAGE_READ)
        rvec, tvec = storage.getNode("rvec").mat().squeeze(), storage.getNode("tvec").mat().squeeze()
        storage.release()
        for truth in read_sequence(sequence).truth or ():
            feet, _ = cv2.projectPoints(truth.feet, rvec, tvec, matrix, distortion)
            heads, _ = cv2.projectPoints(truth.feet + np.array([0, 0, 1.2]), rvec, tvec, matrix, distortion)
            boxes = {one.person: one.boxes[view] for one in read_positions(root / "annotations_positions" / f"{truth.index:05d}.json")}
            for person, (u, v), (hu, hv) in zip(truth.person_id.tolist(), feet[:, 0], heads[:, 0], strict=True):
                xmin, ymin, xmax, ymax = boxes[person]
                assert xmin - 1.5 <= u <= xmax + 1.5
                assert abs(v - ymax) < 4
                assert xmin <= hu <= xmax
                assert ymin < hv < ymax
                checked += 1
    assert checked > 50


def test_positions_and_boxes_equal_the_sequence(sequence: Path, exported: Exported) -> None:
    root = exported("wildtrack") / "plaza"
    region, boxes = read_ground_grid(root / "config.json"), read_boxes(sequence)
    for truth in read_sequence(sequence).truth or ():
        placed = read_positions(root / "annotations_positions" / f"{truth.index:05d}.json")
        assert [one.person for one in placed] == truth.person_id.tolist()
        points = region.points(np.array([one.position for one in placed]))
        assert np.abs(points - truth.feet[:, :2]).max() <= region.cell / 2 + 1e-9
        for one, feet in zip(placed, truth.feet, strict=True):
            assert_array_equal(one.feet, feet)
            for view in range(3):
                true = boxes[truth.index, f"view_{view}"]
                k = np.flatnonzero(true.person == one.person)
                expected = true.full[k[0]] - [0, 0, 1, 1] if len(k) else HIDDEN
                assert_array_equal(one.boxes[view], expected)


def test_png_images_have_the_same_pixels(sequence: Path, exported: Exported) -> None:
    for frame in range(FRAMES):
        png = cv2.imread(str(exported("wildtrack") / "plaza" / "Image_subsets" / "C2" / f"{frame:04d}.png"))
        assert_array_equal(png, cv2.imread(str(sequence / "images" / "view_1" / f"{frame:06d}.jpg")))


def test_rectangles_contain_the_boxes_of_people(sequence: Path, tmp_path: Path) -> None:
    export(sequence, "wildtrack", tmp_path / "out", options=ExportOptions(rectangles=True))
    root = tmp_path / "out" / "plaza"
    region, first = read_ground_grid(root / "config.json"), read_positions(root / "annotations_positions" / "00000.json")
    found = read_rectangles(root / "rectangles.pom", 3, region.columns * region.rows)
    checked = 0
    for one in first:
        for view in range(3):
            box, rectangle = one.boxes[view], found[view, one.position]
            if (box == HIDDEN).all():
                continue
            # Somebody's box and the cylinder's: the same feet, nearly the same head.
            assert abs(box[3] - rectangle[3]) < 0.12 * (rectangle[3] - rectangle[1] + 1)
            assert rectangle[0] <= (box[0] + box[2]) / 2 <= rectangle[2]
            checked += 1
    assert checked > 5
    with pytest.raises(ValueError, match="rectangles is set for coco, needs wildtrack"):
        export(sequence, "coco", tmp_path / "other", options=ExportOptions(rectangles=True))


def test_boxes_and_images_are_read_back(sequence: Path, exported: Exported) -> None:
    original, again = RecordedSequence.open(sequence), read_wildtrack(exported("wildtrack") / "plaza")
    for name, camera in zip(again.cameras, original.fixed, strict=True):
        for k in range(FRAMES):
            boxes, confidence = original.detection_boxes(k, camera)
            found, found_confidence = again.detections[name].get(k, (np.zeros((0, 4)), np.zeros(0)))
            assert_allclose(found + np.array([0.5, 0.5, 0.0, 0.0]), boxes, atol=1e-9)
            assert_array_equal(found_confidence, confidence)
    assert len(list(again.images["C1"].images(FRAMES, (240, 320)))) == FRAMES
