"""Boxes of targets, average precision and calibration."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sim.training.augmentation import visible_parts
from sim.training.evaluation import HEIGHTS, SEEN, FoundImage, corners, feet_errors, heights_of, judged
from sim.training.targets import targets_of
from tracker.metrics.box_detection import WantedBodies, average_precision, box_overlaps
from tracker.person_detector.found_boxes import FoundBoxes, peaks_of
from tracker.person_detector.pixels import Level


def test_peaks_invert_the_targets():
    """A network that says the targets gives the boxes back."""
    boxes = np.array([[50.0, 40.0, 74.0, 100.0], [120.5, 30.0, 160.0, 131.0]])
    made = targets_of(boxes, np.ones(2), 256)
    scores = np.where(made.heat == 1, 3.0, -9.0).astype(np.float32)
    edges = np.log(np.maximum(made.edges, 1e-3)).astype(np.float32)
    found = peaks_of({"scores": scores, "edges": edges}, Level(np.zeros((1, 3, 256, 256), np.float32), (0, 0), 1.0), 0.0)
    order = np.argsort(found.box[:, 0])
    np.testing.assert_allclose(found.box[order, :2], boxes[:, :2], atol=1e-3)
    np.testing.assert_allclose(found.box[order, 2:], boxes[:, 2:] - boxes[:, :2], atol=1e-3)


def test_overlaps_wrap():
    a, b = np.array([[250.0, 0, 270, 10]]), np.array([[-6.0, 0, 14, 10], [100, 0, 120, 10]])
    np.testing.assert_allclose(box_overlaps(a, b, 256.0), [[1, 0]])
    np.testing.assert_allclose(box_overlaps(a, b), [[0, 0]])


def _image(boxes, logits, bodies, visible):
    corners = np.array(boxes, float).reshape(-1, 4)
    found = FoundBoxes(np.hstack([corners[:, :2], corners[:, 2:] - corners[:, :2]]), np.array(logits, float))
    bodies = np.array(bodies, float).reshape(-1, 4)
    return FoundImage(found, bodies, np.array(visible, float), np.zeros(len(bodies), bool), "campus", None, bodies)


def test_average_precision_of_a_drawn_table():
    """Boxes in the order hit, miss, hit, and three bodies: precision 1 up to recall 1/3, then 2/3 up to 2/3, then 0."""
    bodies = [(0, 0, 20, 40), (50, 0, 70, 40), (100, 0, 120, 40)]
    boxes = [(0, 0, 20, 40), (200, 0, 220, 40), (50, 0, 70, 40)]
    logits, hits, count = judged([_image(boxes, [3, 2, 1], bodies, [1, 1, 1])], WantedBodies(HEIGHTS, SEEN), 0.5)
    assert hits[np.argsort(-logits)].tolist() == [True, False, True]
    # 34 of the 101 recalls are at most 1/3, the next 33 at most 2/3.
    np.testing.assert_allclose(average_precision(logits, hits, count), (34 + 33 * 2 / 3) / 101)


def test_tall_bodies_count_in_rooms():
    body = [(0, 0, 200, 400)]
    image = _image([(0, 0, 200, 420)], [3], body, [1])
    assert len(feet_errors([image], 0.5, heights_of("panorama"))) == 0
    np.testing.assert_allclose(feet_errors([image], 0.5, heights_of("room panorama")), [0.05])


def test_hidden_bodies_count_neither_way():
    bodies = [(0, 0, 20, 40), (50, 0, 70, 40)]
    logits, hits, count = judged([_image(bodies, [3, 2], bodies, [1, 0.4])], WantedBodies(HEIGHTS, SEEN), 0.5)
    assert (len(logits), hits.all(), count) == (1, True, 1)


def test_average_precision_needs_the_order_of_the_scores_alone():
    rng = np.random.default_rng(0)
    logits, hits = rng.normal(size=200), rng.random(200) < 0.6
    assert average_precision(logits, hits, 150) == average_precision(np.exp(logits), hits, 150)


def test_calibration_is_monotone_and_finds_the_shares():
    rng = np.random.default_rng(1)
    logits = rng.normal(0.0, 2.0, 20_000)
    hits = rng.random(20_000) < 1 / (1 + np.exp(-0.5 * logits - 1))
    x, p = np.array(corners(logits, hits)).T
    assert (np.diff(x) > 0).all()
    assert (np.diff(p) >= 0).all()
    np.testing.assert_allclose(p, 1 / (1 + np.exp(-0.5 * x - 1)), atol=0.06)
    assert corners(logits[:5], hits[:5]) == ((-10.0, 0.0), (10.0, 1.0))


def test_visible_parts_are_around_the_pixels_of_bodies_and_pass_the_seam():
    instances = np.zeros((40, 100), np.uint8)
    instances[10:30, 20:30] = 1
    instances[5:15, 95:] = instances[5:15, :4] = 2
    boxes = np.array([[20.0, 10.0, 30.0, 38.0], [92.0, 5.0, 106.0, 30.0], [50.0, 0.0, 60.0, 20.0]])
    np.testing.assert_array_equal(visible_parts(instances, np.array([1, 2, 3]), boxes, True), [[20, 10, 30, 30], [95, 5, 104, 15], boxes[2]])


def test_boxes_of_visible_parts_are_compared_with_visible_parts():
    image = _image([(0, 0, 20, 40)], [3], [(0, 0, 20, 40)], [0.4])
    upper = replace(image, parts=np.array([[0.0, 0, 20, 16]]))
    shown = replace(upper, found=replace(upper.found, hidden=np.array([[0.0, 0.0, 0.0, 0.6]])))
    wanted = WantedBodies(HEIGHTS, (0.1, np.inf))
    assert [judged([one], wanted, 0.5, True)[1].tolist() for one in (image, upper, shown)] == [[True], [False], [True]]
