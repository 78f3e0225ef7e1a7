"""Visibility of joints, on images made by hand."""

import numpy as np
import pytest

from sim.sensors.true_boxes import InstanceImage, image_points, true_keypoints
from tracker.geometry import Array, Pose
from tracker.geometry.cameras import Camera, Panorama, Tsai, pinhole
from tracker.types import HIDDEN, KEYPOINT_NAMES, VISIBLE

PANORAMA, PINHOLE = Panorama(360, 180), pinhole(320, 240, 1.2)
EYE = Pose.planar(1.0, 2.0, 0.5, 1.5)
KNEE = KEYPOINT_NAMES.index("left_knee")


def body(place: Array) -> Array:
    """Joints (1, 17, 3) m, world, all at one point (3,) m of the camera frame."""
    return np.broadcast_to(EYE.apply(place), (1, 17, 3)).copy()


def sight(camera: Camera, owner: int, distance: float) -> InstanceImage:
    shape = camera.height, camera.width
    return InstanceImage(camera, EYE, np.full(shape, owner, np.uint16), np.full(shape, distance, np.float32))


@pytest.mark.parametrize("camera", [PANORAMA, PINHOLE])
def test_a_joint_is_visible_behind_its_own_surface_and_hidden_behind_anything_else(camera: Camera) -> None:
    joints, persons = body(np.array([4.0, 0.3, -0.4])), np.array([7])
    distance = float(np.linalg.norm([4.0, 0.3, -0.4]))

    def knee(owner: int, surface: float) -> int:
        return int(true_keypoints(sight(camera, owner, surface), persons, joints).visibility[0, KNEE])

    assert knee(7, distance - 0.06) == VISIBLE  # the knee's own skin
    assert knee(7, distance - 0.25) == HIDDEN  # the other leg
    assert knee(8, distance - 0.06) == HIDDEN  # somebody else's
    assert knee(0, distance - 1.0) == HIDDEN  # a wall
    assert knee(7, distance + 0.06) == VISIBLE  # the joint on the silhouette, a pixel beside it farther back
    assert knee(7, distance + 1.0) == HIDDEN


def test_only_joints_in_the_image_have_pixels() -> None:
    persons = np.array([7])
    aside = true_keypoints(sight(PINHOLE, 7, 3.0), persons, body(np.array([1.0, 2.0, 0.0])))
    behind = true_keypoints(sight(PINHOLE, 7, 3.0), persons, body(np.array([-3.0, 0.0, 0.0])))
    for found in (aside, behind):
        assert not found.visibility.any()
        assert not found.pixels.any()
    around = true_keypoints(sight(PANORAMA, 7, 3.0), persons, body(np.array([-3.0, 0.0, 0.0])))
    assert (around.visibility == VISIBLE).all()
    # The seam: u is 0 or the width.
    assert (np.minimum(around.pixels[..., 0], 360 - around.pixels[..., 0]) < 1e-6).all()


def test_a_joint_a_pixel_off_its_silhouette_is_still_seen_there_across_the_seam() -> None:
    shown = sight(PANORAMA, 0, 3.0)
    shown.instances[:, 359] = 7
    # Just right of the seam, where pixel 0 shows nobody and its neighbour 359 the person.
    joint = 3.0 * PANORAMA.bearings_from_pixels([[0.4, 90.0]])[0]
    assert (true_keypoints(shown, np.array([7]), body(joint)).visibility == VISIBLE).all()
    shown.instances[:] = 0
    assert (true_keypoints(shown, np.array([7]), body(joint)).visibility == HIDDEN).all()


def test_pixels_are_counted_from_the_corner() -> None:
    # The ray of the centre of the first pixel of either model is at (½, ½) of the image.
    tsai = Tsai(768, 576, 5.55, 5.1e-3, 324.2, 282.6, 1.094, 5.127e-3, 4.65e-3)
    for camera in (PANORAMA, PINHOLE, tsai):
        centre = np.array([[camera.pixel_centre + 3, camera.pixel_centre + 5]])
        pixels, inside = image_points(camera, EYE, EYE.apply(6 * camera.bearings_from_pixels(centre)))
        assert inside.all()
        np.testing.assert_allclose(pixels, [[3.5, 5.5]], atol=1e-6)
