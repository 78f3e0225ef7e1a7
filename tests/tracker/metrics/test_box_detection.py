"""Average precision against pycocotools, MODA of a drawn table, images that wrap, and the reliability of scores."""

import contextlib
import io

import numpy as np
import pytest

from tracker.metrics.box_detection import (
    IOUS,
    ImageBoxes,
    JudgedBoxes,
    WantedBodies,
    average_precision,
    best_moda,
    count_boxes,
    feet_errors,
    judge,
    match_by_score,
    outcome_of,
    reliability,
)
from tracker.metrics.box_scores import headline


def crowd(seed, images=12):
    """Bodies in groups, found boxes that are off by some px, second boxes, false ones, and scores of which several are equal."""
    rng = np.random.default_rng(seed)
    out = []
    for _ in range(images):
        count = int(rng.integers(0, 9))
        low = rng.uniform(0, 200, (count, 2))
        size = rng.uniform(20, 90, (count, 1)) * [0.4, 1.0]
        truth = np.concatenate([low, low + size], axis=1)
        copies = np.repeat(truth, 2, axis=0)
        found = copies + rng.normal(0, 0.06, copies.shape) * np.repeat(size, 2, axis=0)[:, [1, 1, 1, 1]] * [0.4, 1, 0.4, 1]
        found = np.concatenate([found[rng.random(len(found)) < 0.7], rng.uniform(0, 200, (3, 4))])
        found = np.concatenate([np.minimum(found[:, :2], found[:, 2:] - 1), found[:, 2:]], axis=1)
        image = ImageBoxes.of(truth, found, np.round(rng.random(len(found)), 1))
        out.append(image)
    return out


def coco_precision(images, wanted):
    """Average precision by pycocotools at its ten thresholds: bodies that are not wanted have an area out of the range."""
    coco_module, evaluation = pytest.importorskip("pycocotools.coco"), pytest.importorskip("pycocotools.cocoeval")
    true, found = [], []
    for index, image in enumerate(images, 1):
        for box, counts in zip(image.truth, wanted.of(image), strict=True):
            ltwh = [*box[:2], *(box[2:] - box[:2])]
            area = 1.0 if counts else 1e9
            true.append({"id": len(true) + 1, "image_id": index, "category_id": 1, "bbox": ltwh, "area": area, "iscrowd": 0})
        for box, score in zip(image.found, image.score, strict=True):
            found.append({"image_id": index, "category_id": 1, "bbox": [*box[:2], *(box[2:] - box[:2])], "score": float(score)})
    truth = coco_module.COCO()
    truth.dataset = {"images": [{"id": k + 1} for k in range(len(images))], "annotations": true, "categories": [{"id": 1}]}
    with contextlib.redirect_stdout(io.StringIO()):
        truth.createIndex()
        run = evaluation.COCOeval(truth, truth.loadRes(found), "bbox")
        run.params.maxDets, run.params.areaRng, run.params.areaRngLbl = [1000], [[0, 1e8]], ["all"]
        run.evaluate()
        run.accumulate()
    return run.eval["precision"][:, :, 0, 0, 0].mean(axis=1)


@pytest.mark.parametrize("seed", range(6))
def test_average_precision_is_that_of_pycocotools(seed):
    images = crowd(seed)
    ours = [judged.average_precision() for judged in judge(images, None, IOUS)]
    np.testing.assert_allclose(ours, coco_precision(images, WantedBodies()), atol=1e-9)
    assert 0.2 < ours[0] < 0.99


@pytest.mark.parametrize("seed", range(4))
def test_ignored_bodies_are_those_of_pycocotools(seed):
    rng = np.random.default_rng(seed)
    images = [
        ImageBoxes(i.truth, i.found, i.score, rng.random(len(i.truth)), i.counts, i.judged, i.truth_feet, i.found_feet) for i in crowd(seed + 10, 20)
    ]
    wanted = WantedBodies(visible=(0.5, np.inf))
    ours = [judged.average_precision() for judged in judge(images, wanted, IOUS)]
    np.testing.assert_allclose(ours, coco_precision(images, wanted), atol=1e-9)


def test_weights_are_repeated_boxes():
    rng = np.random.default_rng(0)
    score, hit, weight = rng.random(60), rng.random(60) < 0.6, rng.integers(0, 3, 60)
    rows = np.repeat(np.arange(60), weight)
    # Of boxes with one score, the last alone ends a step of precision over recall; repeated hits have steps in between.
    found = average_precision(score, hit, 50.0, weight.astype(float))
    assert found == pytest.approx(average_precision(score[rows], hit[rows], 50.0), abs=0.01)
    assert average_precision(score, hit, 50.0, np.ones(60)) == average_precision(score, hit, 50.0)


TABLE = ImageBoxes.of(
    np.array([[0, 0, 20, 40], [50, 0, 70, 40], [100, 0, 120, 40.0]]),
    np.array([[0, 0, 20, 40], [200, 0, 220, 40], [50, 0, 70, 30], [50, 2, 70, 42.0]]),
    np.array([0.9, 0.8, 0.7, 0.2]),
)
"""A hit, a false box, a hit with an IoU of 3/4, and a second box; one body is missed."""


def test_moda_and_modp_of_a_drawn_table():
    counts = count_boxes([TABLE], 0.5)
    assert (counts.bodies.sum(), counts.boxes.sum(), counts.matches.sum()) == (3, 3, 2)
    # One miss and one false box of three bodies; an IoU of 1 and one of 3/4.
    np.testing.assert_allclose([counts.moda(), counts.modp(), counts.precision, counts.recall], [1 - 2 / 3, 0.875, 2 / 3, 2 / 3])
    empty = ImageBoxes.of(np.zeros((0, 4)), np.zeros((0, 4)), np.zeros(0))
    np.testing.assert_allclose(count_boxes([TABLE, empty], 0.5).modp_by_image, 0.875 / 2)
    # Least scores of 0.7 and 0.9 have the same MODA; 0.8 and 0.2 add a false box.
    assert best_moda([TABLE]) == (pytest.approx(1 / 3), 0.7)


def test_the_best_moda_is_not_below_that_of_the_given_score():
    """Of 101 scores, quantiles do not hold the second one, above which all boxes are hits."""
    row = np.arange(101.0)
    boxes = np.stack([30 * row, 0 * row, 30 * row + 20, 0 * row + 40], axis=1)
    scores = headline([ImageBoxes.of(boxes[1:], boxes, row / 100)], WantedBodies(), 0.01)
    assert (scores["moda"], scores["best_moda"], scores["best_moda_score"]) == (1.0, 1.0, 0.01)


def test_ignored_bodies_and_places_that_are_not_judged_count_neither_way():
    hidden = ImageBoxes(
        TABLE.truth, TABLE.found, TABLE.score, np.array([1, 0.3, 1]), TABLE.counts, np.array([True, False, True, True]),
        TABLE.truth_feet, TABLE.found_feet,
    )  # fmt: skip
    counts = count_boxes([hidden], 0.5, WantedBodies(visible=(0.5, np.inf)))
    assert (counts.bodies.sum(), counts.boxes.sum(), counts.matches.sum()) == (2, 1, 1)
    (judged,) = judge([hidden], WantedBodies(visible=(0.5, np.inf)))
    assert judged.hit.tolist() == [True, False]  # the second box of an ignored body is a false one, as in COCO
    low = count_boxes([TABLE], 0.5, WantedBodies(heights=(50, 100)))
    assert (low.bodies.sum(), low.boxes.sum()) == (0, 0)
    assert np.isnan(low.moda())


def test_bodies_across_the_seam():
    image = ImageBoxes(
        np.array([[250.0, 0, 270, 40]]), np.array([[-6.0, 0, 14, 40]]), np.ones(1), np.ones(1), np.ones(1, bool), np.ones(1, bool),
        np.array([[1.0, 2.0]]), np.array([[1.0, 2.5]]), 256.0,
    )  # fmt: skip
    assert judge([image])[0].average_precision() == pytest.approx(1.0)
    assert count_boxes([image], 0.5).moda() == 1
    np.testing.assert_allclose(feet_errors([image], 0.5), [0.5])


def test_crowds_absorb():
    iou = np.array([[0.6, 0.0], [0.7, 0.0], [0.0, 0.9]])
    counted = np.array([False, True])
    assert match_by_score(iou, counted, np.array([0.5])).tolist() == [[0, -1, 1]]
    assert match_by_score(iou, counted, np.array([0.5]), ~counted).tolist() == [[0, 0, 1]]


def test_reliability_of_calibrated_scores():
    rng = np.random.default_rng(0)
    score = rng.random(40_000)
    hit = rng.random(40_000) < score
    good = reliability(JudgedBoxes(score, hit, np.zeros(40_000, int), np.ones(1)))
    np.testing.assert_allclose(good.score, np.arange(0.05, 1, 0.1), atol=0.01)
    assert good.expected_error < 0.01
    # Scores that are too high by their distance from 1, halved.
    bold = reliability(JudgedBoxes((1 + score) / 2, hit, np.zeros(40_000, int), np.ones(1)))
    assert bold.expected_error == pytest.approx(0.25, abs=0.01)
    assert reliability(JudgedBoxes(10 * score, hit, np.zeros(40_000, int), np.ones(1))) is None


def test_outcome_names_each_box_and_body_once() -> None:
    rng = np.random.default_rng(3)
    for _ in range(20):
        low = rng.uniform(0, 100, (2, 12, 2))
        truth, found = np.concatenate([low, low + rng.uniform(10, 60, (2, 12, 2))], axis=2)
        found[:6] = truth[rng.permutation(12)[:6]] + rng.normal(0, 2, (6, 4))
        image, wanted = ImageBoxes.of(truth, found, rng.uniform(0, 1, 12)), WantedBodies((20, 50))
        one = outcome_of(image, 0.3, wanted)
        counts, counted = count_boxes([image], 0.3, wanted), np.flatnonzero(wanted.of(image))
        assert len(one.found) + len(one.missed) == len(counted) == counts.bodies[0]
        assert len(one.found) + len(one.false) == counts.boxes[0]
        assert not set(one.found.tolist()) & set(one.false.tolist())
        assert set(one.missed.tolist()) <= set(counted.tolist())
        assert (image.score[np.concatenate([one.found, one.false])] >= 0.3).all()
