"""COCO export: pycocotools reads it, and its masks equal the instances."""

import contextlib
import io
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from tests.tracker.export.scene import FRAMES
from tracker.formats.coco import person_annotation, read_coco
from tracker.sequence.truth_tables import read_boxes, read_keypoints

Exported = Callable[[str], Path]


@pytest.fixture(scope="module")
def coco(exported: Exported) -> Any:
    module = pytest.importorskip("pycocotools.coco")
    with contextlib.redirect_stdout(io.StringIO()):
        return module.COCO(str(exported("coco") / "annotations" / "plaza.json"))


def instances(sequence: Path, image: dict[str, Any]) -> np.ndarray:
    _, camera, name = image["file_name"].split("/")
    return cv2.imread(str(sequence / "instances" / camera / name.replace(".jpg", ".png")), cv2.IMREAD_UNCHANGED)


def test_masks_equal_instances(sequence: Path, exported: Exported, coco: Any) -> None:
    assert len(coco.imgs) == 4 * FRAMES
    for image in coco.imgs.values():
        assert (exported("coco") / "images" / image["file_name"]).is_file()
        painted = np.zeros((image["height"], image["width"]), dtype=np.int64)
        for annotation in coco.imgToAnns[image["id"]]:
            mask = coco.annToMask(annotation).astype(bool)
            assert not painted[mask].any()
            assert mask.sum() == annotation["area"]
            painted[mask] = annotation["track_id"]
        assert_array_equal(painted, instances(sequence, image))


def test_boxes_bound_masks_across_the_seam(coco: Any) -> None:
    wrapped = 0
    for annotation in coco.anns.values():
        mask = coco.annToMask(annotation).astype(bool)
        x, y, w, h = annotation["bbox"]
        if annotation["wraps"]:
            wrapped += 1
            # Rolled so that the box lies in one piece.
            mask, x = np.roll(mask, -int(x), axis=1), 0
        rows, columns = np.nonzero(mask)
        assert (columns.min(), rows.min(), columns.max() + 1, rows.max() + 1) == (x, y, x + w, y + h)
    assert wrapped >= 1


def test_boxes_and_key_points_equal_the_tables(sequence: Path, exported: Exported) -> None:
    boxes, keypoints = read_boxes(sequence), read_keypoints(sequence)
    content = read_coco(exported("coco") / "annotations" / "plaza.json")
    videos = {video["id"]: video["camera"] for video in content.videos}
    images = {image["id"]: (image["frame_id"], videos[image["video_id"]]) for image in content.images}
    for annotation in content.annotations:
        key, shown = images[annotation["image_id"]], person_annotation(annotation)
        k = boxes[key].person.tolist().index(shown.person)
        assert_array_equal(shown.box[:2] + shown.box[2:], boxes[key].seen[k, 2:])
        assert_array_equal(shown.full[:2] + shown.full[2:], boxes[key].full[k, 2:])
        assert (shown.visible, shown.range) == (boxes[key].visible[k], boxes[key].range[k])
        assert_array_equal(shown.visibility, keypoints[key].visibility[k])
        assert_allclose(shown.pixels, keypoints[key].pixels[k], atol=0.0051)


@pytest.mark.parametrize("kind", ["bbox", "segm", "keypoints"])
def test_truth_gets_full_score(coco: Any, kind: str) -> None:
    evaluation = pytest.importorskip("pycocotools.cocoeval")
    field = "segmentation" if kind == "segm" else kind
    marks = []
    for shift in (0.0, 40.0):
        found = []
        for a in coco.anns.values():
            value = a[field] if kind == "segm" else np.array(a[field], dtype=float).tolist()
            if kind != "segm":
                value[0] += shift
            found.append({"image_id": a["image_id"], "category_id": a["category_id"], "score": 1.0, field: value})
        with contextlib.redirect_stdout(io.StringIO()):
            run = evaluation.COCOeval(coco, coco.loadRes(found), kind)
            run.evaluate()
            run.accumulate()
            run.summarize()
        marks.append(run.stats[0])
    assert marks[0] == pytest.approx(1.0)
    if kind == "bbox":
        assert marks[1] < 0.5
