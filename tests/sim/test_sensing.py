"""The simulator's detector, on instances drawn by hand."""

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from sim.panorama import Alone
from sim.sensing import Detector, true_boxes
from tracker.cameras import Panorama
from tracker.geometry import angles_from_bearing
from tracker.sequence import Boxes

CAMERA = Panorama(360, 180)  # a degree a pixel


def scene() -> tuple[NDArray[np.uint16], list[int], list[Alone]]:
    """Person 7 whole at columns 100–109, rows 80–119; person 3 half hidden; person 5 over the seam; person 9 unseen; person 4 nowhere."""
    instances = np.zeros((180, 360), np.uint16)
    instances[80:120, 100:110] = 7
    instances[80:100, 200:210] = 3
    instances[85:95, :4] = 5
    instances[85:95, 354:] = 5
    alone = [
        Alone(400, np.array([200.0, 80.0, 210.0, 120.0])),
        Alone(0, np.full(4, np.nan)),
        Alone(100, np.array([354.0, 85.0, 364.0, 95.0])),
        Alone(400, np.array([100.0, 80.0, 110.0, 120.0])),
        Alone(50, np.array([10.0, 80.0, 15.0, 90.0])),
    ]
    return instances, [3, 4, 5, 7, 9], alone


def test_true_boxes() -> None:
    boxes = true_boxes(*scene())
    assert boxes.person.tolist() == [3, 5, 7, 9]
    assert boxes.visible.tolist() == [0.5, 1.0, 1.0, 0.0]
    np.testing.assert_array_equal(boxes.seen, [[200, 80, 210, 100], [354, 85, 364, 95], [100, 80, 110, 120], [0, 0, 0, 0]])


def test_a_body_over_the_seam_with_a_hidden_column_keeps_its_width() -> None:
    instances, persons, alone = scene()
    instances[:, 0] = instances[:, 359] = 0
    boxes = true_boxes(instances, persons, alone)
    np.testing.assert_array_equal(boxes.seen[1], [354, 85, 364, 95])


def test_a_perfect_detector_reports_the_visible_boxes_and_nothing_else() -> None:
    boxes = true_boxes(*scene())
    found = Detector(0.0, 0.0, 0.0, 0.2).detect(CAMERA, boxes, 1.5, np.random.default_rng(0))
    assert len(found) == 3
    azimuth, elevation = (np.degrees(a) for a in angles_from_bearing(found.bearing))
    order = np.argsort(azimuth)
    # azimuth = 180° − u, elevation = 90° − v of the middles (205, 90), (105, 100) and (359, 90).
    np.testing.assert_allclose(azimuth[order], [-179.0, -25.0, 75.0])
    np.testing.assert_allclose(elevation[order], [0.0, 0.0, -10.0], atol=1e-9)
    np.testing.assert_allclose(np.degrees(found.extent[order]), [[10, 10], [10, 20], [10, 40]])


def test_misses_and_clutter_come_at_their_rates() -> None:
    boxes = true_boxes(*scene())
    rng = np.random.default_rng(1)
    counts = np.array([len(Detector(0.25, 0.5, 0.001, 0.2).detect(CAMERA, boxes, 1.5, rng)) for _ in range(2000)])
    assert counts.mean() == pytest.approx(3 * 0.75 + 0.5, abs=0.08)


def test_edges_have_the_noise_that_is_asked_for() -> None:
    boxes = true_boxes(*scene())
    rng, sigma = np.random.default_rng(2), math.radians(0.15)
    lows = []
    for _ in range(2000):
        found = Detector(0.0, 0.0, sigma, 0.9).detect(CAMERA, boxes, 1.5, rng)
        azimuth, elevation = angles_from_bearing(found.bearing)
        k = int(np.argmin(np.abs(azimuth - math.radians(75))))
        lows.append(elevation[k] - found.extent[k, 1] / 2)
    assert np.std(lows) == pytest.approx(sigma, rel=0.08)
    assert np.mean(lows) == pytest.approx(math.radians(-30), abs=1e-4)


def test_below_the_least_fraction_nobody_is_seen() -> None:
    boxes = true_boxes(*scene())
    assert len(Detector(0.0, 0.0, 0.0, 0.6).detect(CAMERA, boxes, 1.5, np.random.default_rng(0))) == 2


def test_a_miss_does_not_move_the_noise_of_the_others() -> None:
    boxes = true_boxes(*scene())
    fewer = Boxes(boxes.person, boxes.seen, boxes.full, np.array([0.0, 1.0, 1.0, 0.0]))
    all_of_them, some = (Detector(0.0, 0.0, 0.01, 0.2).detect(CAMERA, b, 1.5, np.random.default_rng(3)) for b in (boxes, fewer))
    assert {tuple(b) for b in some.bearing} < {tuple(b) for b in all_of_them.bearing}


def test_empty_view() -> None:
    boxes = true_boxes(np.zeros((180, 360), np.uint16), [], [])
    assert len(Detector(0.1, 0.0, 0.01, 0.2).detect(CAMERA, boxes, 1.5, np.random.default_rng(0))) == 0
