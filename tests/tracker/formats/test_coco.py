"""COCO export: pycocotools reads it, and its masks equal the instances."""

import contextlib
import io
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays
from numpy.testing import assert_allclose, assert_array_equal

from tests.tracker.formats.scene import FRAMES
from tracker.formats.coco import encode_counts, encode_masks
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
    content = json.loads((exported("coco") / "annotations" / "plaza.json").read_text())
    videos = {video["id"]: video["camera"] for video in content["videos"]}
    images = {image["id"]: (image["frame_id"], videos[image["video_id"]]) for image in content["images"]}
    for shown in content["annotations"]:
        key = images[shown["image_id"]]
        k = boxes[key].person.tolist().index(shown["track_id"])
        for name, edges in (("bbox", boxes[key].seen[k]), ("bbox_full", boxes[key].full[k])):
            assert_array_equal(np.add(shown[name][:2], shown[name][2:]), edges[2:])
        assert (shown["visibility"], shown["range"]) == (boxes[key].visible[k], boxes[key].range[k])
        points = np.reshape(shown["keypoints"], (-1, 3))
        assert_array_equal(points[:, 2], keypoints[key].visibility[k])
        seen = points[:, 2] > 0
        # Key points of COCO count from the middle of the first pixel.
        assert_allclose(points[seen, :2] + 0.5, keypoints[key].pixels[k][seen], atol=0.0051)


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


images = arrays(np.uint16, array_shapes(min_dims=2, max_dims=2, max_side=12), elements=st.sampled_from([0, 0, 1, 2, 65535]))


@settings(max_examples=100, deadline=None)
@given(images)
def test_compressed_counts_equal_those_of_pycocotools(image: np.ndarray) -> None:
    mask = pytest.importorskip("pycocotools.mask")
    found = encode_masks(image)
    assert list(found) == np.unique(image[image > 0]).tolist()
    for person, rle in found.items():
        assert rle.area == (image == person).sum()
        theirs = mask.encode(np.asfortranarray((image == person).astype(np.uint8)))
        assert theirs == {"size": [rle.height, rle.width], "counts": encode_counts(rle.counts).encode()}
