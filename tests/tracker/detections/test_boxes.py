"""Conversion of boxes between pixels and angles: one is the other's inverse, also over the seam of a panorama."""

from __future__ import annotations

import numpy as np
import pytest

from tracker.detections.boxes import approximate_pixel_boxes, detections_from_boxes
from tracker.formats.exported_sequence import boxes_of_detections
from tracker.geometry.cameras import Camera, Cylinder, Fisheye, Panorama, Pinhole, pinhole

CYLINDER = Cylinder(3760, 480, 210.7, 481.0)
DISTORTED = Pinhole(1920, 1080, 1500.0, 1500.0, 965.0, 532.0, (-0.25, 0.0, 0.0, 0.0, 0.0))


@pytest.mark.parametrize(
    ("camera", "tolerance"),
    [
        (pinhole(768, 576, 0.6), 0.5),
        (Panorama(1024, 512), 0.5),
        # A row of the middle of the angles is not the middle of the rows, and a column of a lens has several azimuths.
        (CYLINDER, 1.0),
        (DISTORTED, 1.0),
        (Fisheye(1280, 960, 420.0, 421.0, 633.0, 470.0, (0.02, -0.01, 0.002, 0.0)), 5.0),
    ],
)
def test_pixel_boxes_survive_the_round_trip(camera: Camera, tolerance: float) -> None:
    rng = np.random.default_rng(0)
    size = np.column_stack([rng.uniform(8, 30, 40), rng.uniform(20, 90, 40)])
    corner = rng.uniform(0.3, 0.6, (40, 2)) * [camera.width, camera.height]
    middle, round_trip_size = approximate_pixel_boxes(camera, detections_from_boxes(camera, np.column_stack([corner, size]), np.full(40, 0.9)))
    np.testing.assert_allclose(middle, corner + size / 2, atol=tolerance)
    np.testing.assert_allclose(round_trip_size, size, rtol=0.03)


@pytest.mark.parametrize("camera", [Panorama(1024, 512), CYLINDER])
def test_a_box_over_the_seam_is_as_one_elsewhere(camera: Camera) -> None:
    width, left = camera.width, np.array([-14.0, 0.3, 0.7, 1.0])
    boxes = np.column_stack([left * [1, camera.width, camera.width, camera.width] - [0, 0, 0, 14], np.full((4, 3), [200.0, 28.0, 80.0])])
    found = detections_from_boxes(camera, boxes, np.ones(4))
    for values in (found.extent, found.covariance, found.bearing[:, 2]):
        np.testing.assert_allclose(values, np.broadcast_to(values[1], values.shape), rtol=1e-9)
    middle, size = approximate_pixel_boxes(camera, found)
    assert (np.minimum(middle[[0, 3], 0], width - middle[[0, 3], 0]) < 1).all()
    np.testing.assert_allclose(size, np.broadcast_to([28.0, 80.0], (4, 2)), atol=0.5)
    back = boxes_of_detections(camera, found)
    np.testing.assert_allclose(back[:, 0], boxes[:, 0] % width, atol=1e-6)
    np.testing.assert_allclose(back[:, 1:], boxes[:, 1:], atol=1e-6)


def test_boxes_that_reach_out_of_a_lens_have_a_size_and_a_covariance() -> None:
    """Detections are checked: extents and covariances must be positive."""
    for camera in (DISTORTED, CYLINDER, Fisheye(1000, 1000, 600.0, 600.0, 499.5, 499.5, (-0.08, 0.0, 0.0, 0.0))):
        size = np.array([camera.width, camera.height])
        corner = np.random.default_rng(0).uniform([-60.0, 0.0], size - [0.0, 150.0], (300, 2))
        found = detections_from_boxes(camera, np.column_stack([corner, np.tile([60.0, 150.0], (300, 1))]), np.ones(300))
        assert np.isfinite(found.bearing).all()
        assert (found.extent > 0).all()
        assert (np.linalg.det(found.covariance) > 0).all()


def test_a_box_behind_a_camera_has_no_pixels() -> None:
    ahead, camera = pinhole(640, 480, 1.0), Panorama(1024, 512)
    around = detections_from_boxes(camera, np.array([[0.0, 220.0, 20.0, 60.0], [502.0, 220.0, 20.0, 60.0]]), np.ones(2))
    assert np.isfinite(approximate_pixel_boxes(ahead, around)[0]).all(axis=1).sum() == 1
