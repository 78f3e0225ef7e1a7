"""Resampled images: each pixel of a face shows what the panorama shows in the same direction."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from tracker.formats.camera_parameters import FACES, Resampling, face_camera
from tracker.geometry import Array, bearing_from_angles
from tracker.geometry.cameras import Camera, Cylinder, Fisheye, Panorama, PanoramicCamera, Pinhole

PANORAMA = Panorama(512, 256)


def painted(camera: Camera) -> Array:
    """(H, W, 3): each pixel is its own direction, times 100, so that sampling shows where it looked."""
    shift = camera.pixel_centre
    u, v = np.meshgrid(np.arange(camera.width) + shift, np.arange(camera.height) + shift)
    aim = camera.bearings_from_pixels(np.column_stack([u.ravel(), v.ravel()]))
    return np.asarray(100 * aim.reshape(camera.height, camera.width, 3), dtype=np.float32)


@pytest.mark.parametrize("face", FACES)
def test_faces_show_the_same_directions(face: str) -> None:
    camera = face_camera(PANORAMA)
    seen = Resampling(PANORAMA, camera, FACES[face]).image(painted(PANORAMA)) / 100
    assert_allclose(seen, painted(camera) / 100 @ FACES[face].T, atol=0.5 * 2 * np.pi / PANORAMA.width * (2.1 if face in ("up", "down") else 0.2))


def test_faces_cover_the_sphere_once() -> None:
    """Random directions lie in exactly one face, and the axes of the faces are the six axes of the camera."""
    rng = np.random.default_rng(0)
    bearing = bearing_from_angles(rng.uniform(-np.pi, np.pi, 3000), np.arcsin(rng.uniform(-1, 1, 3000)))
    inside = sum(face_camera(PANORAMA).pixels_from_bearings(bearing @ R)[1].astype(int) for R in FACES.values())
    assert (np.asarray(inside) == 1).all()
    assert_allclose(np.sort([R[:, 0] for R in FACES.values()], axis=0), np.sort(np.concatenate([np.eye(3), -np.eye(3)]), axis=0))
    for R in FACES.values():
        assert_allclose(np.linalg.det(R), 1)
        assert_allclose(R @ R.T, np.eye(3))


def test_the_seam_leaves_no_edge() -> None:
    """The middle columns of the back face lie on both sides of the seam. Their azimuths go on evenly."""
    camera = face_camera(PANORAMA)
    row = Resampling(PANORAMA, camera, FACES["back"]).image(painted(PANORAMA))[camera.height // 2] / 100
    assert np.abs(np.diff(row[:, 1])).max() < 1.2 / camera.fx


@pytest.mark.parametrize(
    ("source", "target"),
    [
        (Pinhole(320, 240, 250.0, 250.0, 159.5, 119.5, (-0.2, 0.03, 1e-3, -5e-4, 0.0)), Pinhole(320, 240, 250.0, 250.0, 159.5, 119.5)),
        (Fisheye(320, 320, 100.0, 100.0, 159.5, 159.5, (0.02, -0.003, 0.0, 0.0)), Pinhole(200, 200, 100.0, 100.0, 99.5, 99.5)),
    ],
)
def test_lenses_are_straightened(source: Camera, target: Camera) -> None:
    seen = Resampling(source, target, np.eye(3)).image(painted(source))
    known = seen.any(axis=2)
    assert known.mean() > 0.8
    inner = known & np.roll(known, 1, 0) & np.roll(known, -1, 0) & np.roll(known, 1, 1) & np.roll(known, -1, 1)
    assert_allclose(seen[inner] / 100, painted(target)[inner] / 100, atol=2e-4)


def test_what_a_cylinder_does_not_see_is_black() -> None:
    cylinder: PanoramicCamera = Cylinder(512, 60, 30.0, 512 / (2 * np.pi))
    seen = Resampling(cylinder, face_camera(cylinder), FACES["front"]).image(painted(cylinder))
    middle = seen[:, seen.shape[1] // 2]
    shown = np.abs(np.arange(len(middle)) - (len(middle) - 1) / 2) < 30
    assert (middle.any(axis=1) == shown).all()
