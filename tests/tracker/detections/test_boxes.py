"""Conversion of boxes between pixels and angles: one is the other's inverse, also over the seam of a panorama."""

from __future__ import annotations

import numpy as np
import pytest

from tracker.detections.boxes import approximate_pixel_boxes, detections_from_boxes
from tracker.geometry.cameras import Camera, Panorama, pinhole


@pytest.mark.parametrize("camera", [pinhole(768, 576, 0.6), Panorama(1024, 512)])
def test_pixel_boxes_survive_the_round_trip(camera: Camera) -> None:
    rng = np.random.default_rng(0)
    size = np.column_stack([rng.uniform(8, 30, 40), rng.uniform(20, 90, 40)])
    corner = rng.uniform(0.3, 0.6, (40, 2)) * [camera.width, camera.height]
    middle, round_trip_size = approximate_pixel_boxes(camera, detections_from_boxes(camera, np.column_stack([corner, size]), np.full(40, 0.9)))
    np.testing.assert_allclose(middle, corner + size / 2, atol=0.5)
    np.testing.assert_allclose(round_trip_size, size, rtol=0.03)


def test_a_box_over_the_seam_keeps_its_width() -> None:
    camera = Panorama(1024, 512)
    found = detections_from_boxes(camera, np.array([[1010.0, 200.0, 28.0, 80.0]]), np.ones(1))
    middle, size = approximate_pixel_boxes(camera, found)
    assert min(middle[0, 0], 1024 - middle[0, 0]) < 1
    np.testing.assert_allclose(size[0], [28, 80], atol=0.5)


def test_a_box_behind_a_camera_has_no_pixels() -> None:
    ahead, camera = pinhole(640, 480, 1.0), Panorama(1024, 512)
    around = detections_from_boxes(camera, np.array([[0.0, 220.0, 20.0, 60.0], [502.0, 220.0, 20.0, 60.0]]), np.ones(2))
    assert np.isfinite(approximate_pixel_boxes(ahead, around)[0]).all(axis=1).sum() == 1


def test_no_boxes() -> None:
    camera = pinhole(640, 480, 1.0)
    middle, size = approximate_pixel_boxes(camera, detections_from_boxes(camera, np.zeros((0, 4)), np.zeros(0)))
    assert middle.shape == size.shape == (0, 2)
