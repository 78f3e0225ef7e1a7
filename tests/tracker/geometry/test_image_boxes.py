"""Boxes of bodies: tight around the body in every camera model, whole over the seam, cut at the image."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from tracker.geometry import Array, Pose
from tracker.geometry.camera_protocol import Camera
from tracker.geometry.cameras import Cylinder, Fisheye, Panorama, Pinhole, pinhole
from tracker.geometry.image_boxes import body_boxes

LOOKING_DOWN = Pose(Pose.exp([0, 0, 0, 0, 0.3, 0]).rotation, np.array([0.0, 0.0, 2.5]))
"""A camera 2.5 m above the ground that looks along x and 0.3 rad down."""
CAMERAS: dict[str, Camera] = {
    "pinhole": Pinhole(1920, 1080, 1000, 1000, 960, 540, (-0.1, 0.02, 0.001, 0.001, 0)),
    "fisheye": Fisheye(1000, 1000, 300, 300, 500, 500, (0.01, 0, 0, 0)),
    "panorama": Panorama(2048, 1024),
    "cylinder": Cylinder(3760, 480, 210.7, 481),
    "tsai": pinhole(1920, 1080, 1.2),
}


def surface(feet: Array, height: float, width: float) -> Array:
    """Many points of the upright cylinder, (n, 3) m."""
    angle, z = (a.ravel() for a in np.meshgrid(np.linspace(0, 2 * np.pi, 720), np.linspace(0, height, 50)))
    return np.asarray(feet + np.column_stack([width / 2 * np.cos(angle), width / 2 * np.sin(angle), z]))


@pytest.mark.parametrize("name", CAMERAS)
def test_a_box_is_tight_around_the_body(name: str) -> None:
    camera = CAMERAS[name]
    pose = Pose(np.eye(3), np.array([0.0, 0.0, 1.0])) if camera.wraps else LOOKING_DOWN
    feet = np.array([[7.0, 1.5, 0.0], [9.0, -1.0, 0.0]])
    boxes = body_boxes(camera, pose, feet)
    assert len(boxes) == 2
    for foot, (left, top, width, height) in zip(feet, boxes, strict=True):
        rays = pose.inverse().apply(surface(foot, 1.75, 0.5))
        pixels = camera.pixels_from_bearings(rays / np.linalg.norm(rays, axis=1, keepdims=True))[0]
        size = pixels.max(axis=0) - pixels.min(axis=0)
        assert_allclose([left, top], pixels.min(axis=0), atol=0.02 * size.max())
        assert_allclose([width, height], size, atol=0.02 * size.max())


@pytest.mark.parametrize("name", ["panorama", "cylinder"])
def test_a_body_over_the_seam_has_one_box(name: str) -> None:
    """The same body ahead and behind: the box is shifted by half the image."""
    camera, pose = CAMERAS[name], Pose(np.eye(3), np.array([0.0, 0.0, 1.0]))
    ahead, behind = body_boxes(camera, pose, np.array([[5.0, 0.1, 0.0], [-5.0, -0.1, 0.0]]))
    assert_allclose(behind[1:], ahead[1:], atol=1e-9)
    assert_allclose((behind[0] - ahead[0]) % camera.width, camera.width / 2)
    assert behind[0] < camera.width < behind[0] + behind[2]


def test_a_box_ends_at_the_image_and_slivers_have_none() -> None:
    """A camera that looks level from 1 m sees no feet nearer than 1 / tan(half the field)."""
    camera, pose = pinhole(400, 400, np.pi / 2), Pose(np.eye(3), np.array([0.0, 0.0, 1.0]))
    near, far = body_boxes(camera, pose, np.array([[0.9, 0.0, 0.0], [5.0, 0.0, 0.0]]), body=(1.75, 0.2))
    assert_allclose(near[1] + near[3], 399.5)
    assert far[1] + far[3] < 399
    # Behind the camera, beside the image, and with less than a quarter of the box in it.
    assert len(body_boxes(camera, pose, np.array([[-5.0, 0.0, 0.0], [5.0, 9.0, 0.0], [5.0, 5.2, 0.0]]))) == 0
