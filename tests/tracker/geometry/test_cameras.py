"""Camera models: pixels to bearings and back, for all cameras and for each model."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from tracker.geometry import Array, angles_from_bearing, bearing_from_angles
from tracker.geometry.cameras import OPTICAL_FROM_CAMERA, Camera, Panorama, Tsai

# View_001 and View_007 of PETS 2009; the third has no distortion, the fourth a strong one with no root beyond 3.2 mm.
VIEW_001 = Tsai(768, 576, 5.5549183034, 5.1113043639e-3, 324.22149053, 282.56650051, 1.0937855397, 5.1273271277e-3, 4.65e-3)
VIEW_007 = Tsai(720, 576, 3.6936729025, -6.1986350417e-2, 436.10005997, 257.92023557, 1.0, 4.65e-3, 4.65e-3)
PINHOLE = Tsai(640, 480, 4.0, 0.0, 320.0, 240.0, 1.0, 5e-3, 5e-3)
BARREL = Tsai(640, 480, 3.0, -0.03, 300.0, 250.0, 1.1, 4e-3, 5e-3)

CAMERAS = {
    "panorama": Panorama(1024, 512),
    "small panorama": Panorama(2, 1),
    "view 1": VIEW_001,
    "view 7": VIEW_007,
    "pinhole": PINHOLE,
    "barrel": BARREL,
}


@pytest.fixture(params=CAMERAS.values(), ids=CAMERAS.keys())
def camera(request: Any) -> Camera:
    return request.param


def fold(camera: Camera) -> float:
    """The radius on the sensor, mm, beyond which Tsai's model with κ1 < 0 folds back on itself."""
    if isinstance(camera, Tsai) and camera.kappa1 < 0:
        return float(np.sqrt(-1 / (3 * camera.kappa1)))
    return np.inf


def pixels_inside(camera: Camera) -> Array:
    """Pixels of the image at which the model has an inverse."""
    u, v = np.meshgrid(np.linspace(0, camera.width, 41)[1:-1], np.linspace(0, camera.height, 31)[1:-1])
    p = np.stack([u.ravel(), v.ravel()], axis=1)
    if isinstance(camera, Tsai):
        radius = np.hypot((p[:, 0] - camera.cx) * camera.dpx / camera.sx, (p[:, 1] - camera.cy) * camera.dpy)
        p = p[radius < 0.999 * fold(camera)]
    return p


# --- the contract -----------------------------------------------------------------------------------------------------------------


def test_pixels_go_to_bearings_and_back(camera: Camera) -> None:
    pixels = pixels_inside(camera)
    bearings = camera.bearings_from_pixels(pixels)
    assert_allclose(np.linalg.norm(bearings, axis=1), 1, atol=1e-12)
    again, inside = camera.pixels_from_bearings(bearings)
    assert inside.all()
    assert_allclose(again, pixels, atol=1e-5)


def test_bearings_need_not_be_unit(camera: Camera) -> None:
    bearings = camera.bearings_from_pixels(pixels_inside(camera))
    near, far = camera.pixels_from_bearings(0.1 * bearings)[0], camera.pixels_from_bearings(50 * bearings)[0]
    assert_allclose(near, far, atol=1e-5)


def test_bearings_go_to_pixels_and_back(camera: Camera) -> None:
    d = np.random.default_rng(0).normal(0, 1, (2000, 3))
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    pixels, inside = camera.pixels_from_bearings(d)
    assert inside.any()
    assert_allclose(camera.bearings_from_pixels(pixels[inside]), d[inside], atol=1e-7)
    size = np.array([camera.width, camera.height])
    assert ((pixels[inside] >= 0) & (pixels[inside] <= size)).all()
    outside = pixels[~inside]
    assert (np.isnan(outside).any(axis=1) | (outside < 0).any(axis=1) | (outside > size).any(axis=1)).all()


def test_axes_up_and_left_in_the_image(camera: Camera) -> None:
    # In an image u grows to the right, v downwards; in the camera's frame y is left and z up.
    middle = np.array([[camera.width / 2, camera.height / 2]])
    step = np.array([camera.width, camera.height]) / 100
    b, right, below = (camera.bearings_from_pixels(middle + s)[0] for s in (0 * step, step * [1, 0], step * [0, 1]))
    assert b[0] > 0.8
    assert right[1] < b[1]
    assert below[2] < b[2]


def test_empty_input_gives_empty_output(camera: Camera) -> None:
    assert camera.bearings_from_pixels(np.zeros((0, 2))).shape == (0, 3)
    pixels, inside = camera.pixels_from_bearings(np.zeros((0, 3)))
    assert pixels.shape == (0, 2)
    assert inside.shape == (0,)


# --- panorama ---------------------------------------------------------------------------------------------------------------------


def test_panorama_middle_is_forward_and_seam_is_behind() -> None:
    p = Panorama(400, 200)
    directions = np.array([[1.0, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [-1, 0, 0], [-1, -1e-12, 0]])
    pixels, inside = p.pixels_from_bearings(directions)
    assert inside.all()
    assert_allclose(pixels[:3], [[200, 100], [100, 100], [300, 100]])
    assert_allclose(pixels[3, 1], 0, atol=1e-9)
    # Both sides of the seam lie in [0, width).
    assert_allclose(pixels[4:, 0] % 400 % (400 - 1e-6), 0, atol=1e-6)
    assert ((pixels[:, 0] >= 0) & (pixels[:, 0] < 400)).all()


def test_panorama_formula() -> None:
    # azimuth = π − 2πu/W, elevation = π/2 − πv/H.
    azimuth, elevation = angles_from_bearing(Panorama(360, 180).bearings_from_pixels([[10.0, 30.0], [350.0, 170.0]]))
    assert_allclose(np.degrees(azimuth), [170, -170])
    assert_allclose(np.degrees(elevation), [60, -80])


def test_panorama_pixels_wrap_around_the_seam() -> None:
    p = Panorama(360, 180)
    assert_allclose(p.bearings_from_pixels([[-5.0, 40]]), p.bearings_from_pixels([[355.0, 40]]), atol=1e-12)


# --- Tsai -------------------------------------------------------------------------------------------------------------------------


def test_tsai_without_distortion_is_a_pinhole() -> None:
    # fx = focal sx / dpx = 800 px: a point 2 m ahead, 0.5 m left, 0.25 m up.
    pixels, inside = PINHOLE.pixels_from_bearings([[2.0, 0.5, 0.25], [-2.0, 0.5, 0.25], [0, 1, 0]])
    assert_allclose(pixels[0], [320 - 200, 240 - 100])
    assert_array_equal(inside, [True, False, False])
    assert np.isnan(pixels[1:]).all()


def test_undistorted_is_distorted_times_one_plus_kappa_r_squared() -> None:
    # 1 mm beside the middle: the undistorted point is 1 + κ1 mm beside it.
    for camera in (VIEW_001, VIEW_007):
        (b,) = camera.bearings_from_pixels([[camera.cx + camera.sx / camera.dpx, camera.cy]])
        assert_allclose(-b[1] / b[0] * camera.focal, 1 + camera.kappa1)


@pytest.mark.parametrize("camera", [VIEW_007, BARREL])
def test_negative_kappa_has_directions_without_a_pixel(camera: Tsai) -> None:
    largest = fold(camera) * (1 + camera.kappa1 * fold(camera) ** 2)
    slope = np.array([0.5, 0.99, 0.999999, 1.000001, 1.01, 2.0]) * largest / camera.focal
    pixels, inside = camera.pixels_from_bearings(np.column_stack([np.ones(6), slope, np.zeros(6)]))
    assert_array_equal(np.isnan(pixels).any(axis=1), [False] * 3 + [True] * 3)
    assert not inside[3:].any()
    solved = (camera.cx - pixels[:3, 0]) * camera.dpx / camera.sx
    assert (solved <= fold(camera)).all()
    assert_allclose(solved * (1 + camera.kappa1 * solved**2), slope[:3] * camera.focal, atol=1e-6)


def test_pixel_beyond_the_fold_has_the_direction_of_the_model() -> None:
    # The left corners of View_007 lie beyond: each shares its direction with a pixel within.
    corner = np.array([[0.0, 0.0], [0.0, 576.0]])
    b = VIEW_007.bearings_from_pixels(corner)
    again, inside = VIEW_007.pixels_from_bearings(b)
    assert inside.all()
    assert (np.linalg.norm(again - corner, axis=1) > 5).all()
    assert_allclose(VIEW_007.bearings_from_pixels(again), b, atol=1e-7)


def test_directions_far_off_axis_are_finite() -> None:
    # Up to a hair of the image plane, and behind it.
    d = bearing_from_angles(np.linspace(-np.pi, np.pi, 2001), np.zeros(2001))
    for camera in (VIEW_001, VIEW_007, PINHOLE, BARREL):
        with np.errstate(all="raise", under="ignore"):
            pixels, inside = camera.pixels_from_bearings(d)
        assert not inside[d[:, 0] <= 0].any()
        assert np.isfinite(pixels[inside]).all()


def test_optical_frame_and_camera_frame() -> None:
    # Forward is +z of the optical frame, left −x, up −y; a rotation.
    assert_array_equal(OPTICAL_FROM_CAMERA @ np.eye(3), [[0, -1, 0], [0, 0, -1], [1, 0, 0]])
    assert np.linalg.det(OPTICAL_FROM_CAMERA) == 1


@pytest.mark.parametrize(
    ("make", "text"),
    [
        (lambda: Panorama(100, 60), "needs width = 2 height"),
        (lambda: Panorama(0, 0), "image size is 0 x 0"),
        (lambda: dataclasses.replace(PINHOLE, width=0), "image size is 0 x 480"),
        (lambda: dataclasses.replace(PINHOLE, focal=0.0), "focal is 0.0, needs more than 0"),
        (lambda: dataclasses.replace(PINHOLE, sx=float("nan")), "sx is nan, needs more than 0"),
        (lambda: dataclasses.replace(PINHOLE, dpx=-1.0), "dpx is -1.0, needs more than 0"),
        (lambda: dataclasses.replace(PINHOLE, kappa1=float("nan")), "kappa1 is nan, needs a finite number"),
        (lambda: dataclasses.replace(PINHOLE, cx=float("inf")), "cx is inf, needs a finite number"),
    ],
)
def test_cameras_are_checked(make: Any, text: str) -> None:
    with pytest.raises(ValueError, match=text):
        make()
