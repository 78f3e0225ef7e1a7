"""The simulator's detector, on instances drawn by hand."""

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from sim.rendering.coverage import UnoccludedExtent
from sim.sensors.true_boxes import InstanceImage, People, true_boxes
from tracker.detector_models.independent import IndependentErrors
from tracker.geometry import Pose, angles_from_bearing
from tracker.geometry.cameras import Camera, Panorama, pinhole
from tracker.types import Boxes, Keypoints, ViewTruth

CAMERA = Panorama(360, 180)  # a degree a pixel


EYE = Pose.planar(0.0, 0.0, 0.0, 1.5)


def scene() -> tuple[NDArray[np.uint16], list[int], list[UnoccludedExtent]]:
    """Person 7 whole at columns 100–109, rows 80–119; person 3 half hidden; person 5 over the seam; person 9 unseen; person 4 nowhere."""
    instances = np.zeros((180, 360), np.uint16)
    instances[80:120, 100:110] = 7
    instances[80:100, 200:210] = 3
    instances[85:95, :4] = 5
    instances[85:95, 354:] = 5
    unoccluded = [
        UnoccludedExtent(400, np.array([200.0, 80.0, 210.0, 120.0])),
        UnoccludedExtent(0, np.full(4, np.nan)),
        UnoccludedExtent(100, np.array([354.0, 85.0, 364.0, 95.0])),
        UnoccludedExtent(400, np.array([100.0, 80.0, 110.0, 120.0])),
        UnoccludedExtent(50, np.array([10.0, 80.0, 15.0, 90.0])),
    ]
    return instances, [3, 4, 5, 7, 9], unoccluded


def boxes_of(instances: NDArray[np.uint16], persons: list[int], unoccluded: list[UnoccludedExtent], camera: Camera = CAMERA) -> Boxes:
    """True boxes of people whose hips are person · 0.5 m ahead of the camera."""
    joints = np.zeros((len(persons), 17, 3)) + np.array([0.0, 0.0, 1.5])
    joints[:, :, 0] = 0.5 * np.array(persons)[:, None]
    sight = InstanceImage(camera, EYE, instances, np.zeros(instances.shape, np.float32))
    return true_boxes(sight, People(np.array(persons, dtype=np.int64), joints), unoccluded)


def view(boxes: Boxes) -> ViewTruth:
    return ViewTruth(EYE, 0.0, np.array([0.0, 0.0, 1.0]), boxes, Keypoints.none())


def test_true_boxes() -> None:
    boxes = boxes_of(*scene())
    assert boxes.person.tolist() == [3, 5, 7, 9]
    assert boxes.visible.tolist() == [0.5, 1.0, 1.0, 0.0]
    np.testing.assert_allclose(boxes.range, [1.5, 2.5, 3.5, 4.5])
    np.testing.assert_array_equal(boxes.seen, [[200, 80, 210, 100], [354, 85, 364, 95], [100, 80, 110, 120], [0, 0, 0, 0]])


def test_a_body_over_the_seam_with_a_hidden_column_keeps_its_width() -> None:
    instances, persons, unoccluded = scene()
    instances[:, 0] = instances[:, 359] = 0
    boxes = boxes_of(instances, persons, unoccluded)
    np.testing.assert_array_equal(boxes.seen[1], [354, 85, 364, 95])


def test_a_perfect_detector_reports_the_visible_boxes_and_nothing_else() -> None:
    boxes = boxes_of(*scene())
    found = IndependentErrors(0.0, 0.0, 0.0, 0.2).detect(CAMERA, view(boxes), np.random.default_rng(0))
    assert len(found) == 3
    azimuth, elevation = (np.degrees(a) for a in angles_from_bearing(found.bearing))
    order = np.argsort(azimuth)
    # azimuth = 180° − u, elevation = 90° − v of the middles (205, 90), (105, 100) and (359, 90).
    np.testing.assert_allclose(azimuth[order], [-179.0, -25.0, 75.0])
    np.testing.assert_allclose(elevation[order], [0.0, 0.0, -10.0], atol=1e-9)
    np.testing.assert_allclose(np.degrees(found.extent[order]), [[10, 10], [10, 20], [10, 40]])


def test_misses_and_clutter_come_at_their_rates() -> None:
    boxes = boxes_of(*scene())
    rng = np.random.default_rng(1)
    counts = np.array([len(IndependentErrors(0.25, 0.5, 0.001, 0.2).detect(CAMERA, view(boxes), rng)) for _ in range(2000)])
    assert counts.mean() == pytest.approx(3 * 0.75 + 0.5, abs=0.08)


def test_edges_have_the_noise_that_is_asked_for() -> None:
    boxes = boxes_of(*scene())
    rng, sigma = np.random.default_rng(2), math.radians(0.15)
    lows = []
    for _ in range(2000):
        found = IndependentErrors(0.0, 0.0, sigma, 0.9).detect(CAMERA, view(boxes), rng)
        azimuth, elevation = angles_from_bearing(found.bearing)
        k = int(np.argmin(np.abs(azimuth - math.radians(75))))
        lows.append(elevation[k] - found.extent[k, 1] / 2)
    assert np.std(lows) == pytest.approx(sigma, rel=0.08)
    assert np.mean(lows) == pytest.approx(math.radians(-30), abs=1e-4)


def test_people_below_the_visible_fraction_are_not_detected() -> None:
    boxes = boxes_of(*scene())
    assert len(IndependentErrors(0.0, 0.0, 0.0, 0.6).detect(CAMERA, view(boxes), np.random.default_rng(0))) == 2


def test_a_miss_does_not_change_the_noise_of_the_others() -> None:
    boxes = boxes_of(*scene())
    fewer = Boxes(boxes.person, boxes.seen, boxes.full, np.array([0.0, 1.0, 1.0, 0.0]), boxes.range)
    all_of_them, some = (IndependentErrors(0.0, 0.0, 0.01, 0.2).detect(CAMERA, view(b), np.random.default_rng(3)) for b in (boxes, fewer))
    assert {tuple(b) for b in some.bearing} < {tuple(b) for b in all_of_them.bearing}


def test_a_pinhole_has_no_seam() -> None:
    camera = pinhole(360, 180, 1.2)
    boxes = boxes_of(*scene(), camera=camera)
    np.testing.assert_array_equal(boxes.seen[1], [0, 85, 360, 95])


def test_a_perfect_detector_on_a_pinhole_reports_the_visible_boxes() -> None:
    camera = pinhole(360, 180, 1.2)
    instances, persons, unoccluded = scene()
    instances[85:95, 354:] = 0
    boxes = boxes_of(instances, persons, unoccluded, camera)
    found = IndependentErrors(0.0, 0.0, 0.0, 0.2).detect(camera, view(boxes), np.random.default_rng(0))
    # The bearing's azimuth is that of the middle of the lower edge, which in a level pinhole is that of its column.
    focal = 180 / np.tan(0.6)
    azimuth, elevation = angles_from_bearing(found.bearing)
    np.testing.assert_allclose(np.sort(180 - focal * np.tan(azimuth)), [2, 105, 205], atol=1e-6)
    low = elevation - found.extent[:, 1] / 2
    row = 90 - focal * np.tan(low) / np.cos(azimuth)
    np.testing.assert_allclose(np.sort(row), [95, 100, 120], atol=1e-6)


def test_clutter_of_a_pinhole_stands_on_the_ground() -> None:
    camera = pinhole(360, 180, 1.2)
    boxes = boxes_of(np.zeros((180, 360), np.uint16), [], [], camera)
    rng, heights, count = np.random.default_rng(4), [], 0
    for _ in range(300):
        found = IndependentErrors(0.0, 1.0, 0.0, 0.2).detect(camera, view(boxes), rng)
        _, elevation = angles_from_bearing(found.bearing)
        low, high = elevation - found.extent[:, 1] / 2, elevation + found.extent[:, 1] / 2
        heights += list(1.5 * (1 - np.tan(high) / np.tan(low)))
        count += len(found)
    assert count == pytest.approx(300, abs=60)
    # The eye is 1.5 m over the ground: a box's lower edge is at its feet, its upper edge 1.5 to 2 m higher.
    assert 1.49 < min(heights) < 1.6
    assert 1.9 < max(heights) < 2.01
