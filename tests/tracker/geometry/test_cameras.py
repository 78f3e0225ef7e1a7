"""The contract of cameras, for every model: pixels to bearings and back, the seam, blind pixels, what is in the image, and empty input."""

from __future__ import annotations

import pickle
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from tests.tracker.geometry.random_cameras import MAKERS, image_pixels, random_camera
from tracker.geometry import Array
from tracker.geometry.cameras import OPTICAL_FROM_CAMERA, Camera, Cylinder, Fisheye, Panorama, Pinhole, Tsai

# View_001 and View_007 of PETS 2009; BARREL has no root beyond 3.2 mm.
VIEW_001 = Tsai(768, 576, 5.5549183034, 5.1113043639e-3, 324.22149053, 282.56650051, 1.0937855397, 5.1273271277e-3, 4.65e-3)
VIEW_007 = Tsai(720, 576, 3.6936729025, -6.1986350417e-2, 436.10005997, 257.92023557, 1.0, 4.65e-3, 4.65e-3)
BARREL = Tsai(640, 480, 3.0, -0.03, 300.0, 250.0, 1.1, 4e-3, 5e-3)

CAMERAS: dict[str, Camera] = {
    "panorama": Panorama(1024, 512),
    "small panorama": Panorama(2, 1),
    "JRDB's cylinder": Cylinder(3760, 480, 210.7, 481.0),
    "pinhole": Pinhole(1920, 1080, 1100.0, 1095.0, 965.0, 532.0),
    "distorted pinhole": Pinhole(1920, 1080, 1100.0, 1095.0, 965.0, 532.0, (-0.32, 0.14, 0.002, -0.003, -0.02)),
    "fisheye": Fisheye(1280, 960, 420.0, 421.0, 633.0, 470.0, (0.02, -0.01, 0.002, -0.0004)),
    "fisheye of 220°": Fisheye(1000, 1000, 500 / np.radians(110), 500 / np.radians(110), 499.5, 499.5),
    "view 1": VIEW_001,
    "view 7": VIEW_007,
    "barrel": BARREL,
}
CAMERAS |= {f"{model} {seed}": random_camera(model, seed) for model in MAKERS for seed in range(12)}


@pytest.fixture(params=CAMERAS.values(), ids=CAMERAS.keys())
def camera(request: Any) -> Camera:
    return request.param


def inside_fold(camera: Camera) -> Array:
    """Pixels of the image, in Tsai's model those within 0.999 of the fold's radius: its solution is less exact at the fold."""
    pixels = image_pixels(camera, 0)
    if isinstance(camera, Tsai):
        pixels = pixels[~replace(camera, kappa1=camera.kappa1 / 0.999**2).blind(pixels)]
    return pixels


def corner(camera: Camera) -> Array:
    """The upper left corner of the image (2,), px."""
    return np.full(2, camera.pixel_centre - 0.5)


def test_pixels_go_to_bearings_and_back(camera: Camera) -> None:
    pixels = inside_fold(camera)
    bearings = camera.bearings_from_pixels(pixels)
    again, _ = camera.pixels_from_bearings(bearings)
    apart = again - pixels
    if camera.wraps:
        # The left and the right edge of the image are the same direction.
        apart[:, 0] -= camera.width * np.round(apart[:, 0] / camera.width)
    if isinstance(camera, Panorama):
        # At the poles, all columns are the same direction.
        apart[(pixels[:, 1] <= 0) | (pixels[:, 1] >= camera.height), 0] = 0.0
    assert_allclose(apart, 0.0, atol=1e-6)


def test_bearings_are_unit_and_finite_within_and_around_the_image(camera: Camera) -> None:
    size = np.array([camera.width, camera.height])
    bearings = camera.bearings_from_pixels(np.random.default_rng(1).uniform(-size, 2 * size, (500, 2)))
    assert_allclose(np.linalg.norm(bearings, axis=1), 1.0, atol=1e-12)


def test_bearings_need_not_be_unit(camera: Camera) -> None:
    bearings = camera.bearings_from_pixels(inside_fold(camera)[4:])
    near, far = camera.pixels_from_bearings(0.1 * bearings)[0], camera.pixels_from_bearings(50 * bearings)[0]
    assert_allclose(near, far, atol=1e-5)


def test_inside_are_the_directions_whose_pixels_lie_in_the_image(camera: Camera) -> None:
    d = np.random.default_rng(2).normal(0, 1, (2000, 3))
    pixels, inside = camera.pixels_from_bearings(d)
    assert np.isfinite(pixels[inside]).all()
    # Tsai's image ends at whole numbers, as the tracker has it for PETS 2009.
    low = np.zeros(2) if isinstance(camera, Tsai) else corner(camera)
    high = low + np.array([camera.width, camera.height])
    with np.errstate(invalid="ignore"):
        assert_array_equal(inside, ((pixels >= low) & (pixels <= high)).all(axis=1))


def test_a_pixel_has_one_direction(camera: Camera) -> None:
    """No two directions share a pixel: those that a distortion would fold back have none."""
    d = np.random.default_rng(3).normal(0, 1, (4000, 3))
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    pixels, inside = camera.pixels_from_bearings(d)
    assert inside.any()
    assert not camera.blind(pixels[inside]).any()
    known = np.isfinite(pixels).all(axis=1)
    apart = np.linalg.norm(camera.bearings_from_pixels(pixels[known]) - d[known], axis=1)
    assert apart.max() < 1e-6


def test_directions_of_blind_pixels_project_elsewhere(camera: Camera) -> None:
    size = np.array([camera.width, camera.height])
    pixels = np.random.default_rng(4).uniform(-size, 2 * size, (2000, 2))
    pixels = pixels[camera.blind(pixels)]
    again, _ = camera.pixels_from_bearings(camera.bearings_from_pixels(pixels))
    assert not (np.linalg.norm(again - pixels, axis=1) < 1e-9).any()


def test_axes_up_and_left_in_the_image(camera: Camera) -> None:
    # In an image u grows to the right, v downwards; in the camera's frame y is left and z up.
    middle = corner(camera) + np.array([[camera.width / 2, camera.height / 2]])
    step = np.array([camera.width, camera.height]) / 100
    b, right, below = (camera.bearings_from_pixels(middle + s)[0] for s in (0 * step, step * [1, 0], step * [0, 1]))
    assert b[0] > 0.1
    assert right[1] < b[1]
    assert below[2] < b[2]


def test_an_image_that_wraps_continues_its_left_edge_at_its_right_edge(camera: Camera) -> None:
    v = np.linspace(0.0, camera.height, 7)[1:-1]
    for u in (0.0, 0.3 * camera.width, -0.1 * camera.width):
        left, right = (camera.bearings_from_pixels(np.column_stack([np.full_like(v, at), v])) for at in (u, u + camera.width))
        assert np.allclose(left, right, atol=1e-9) == camera.wraps


def test_empty_input_gives_empty_output(camera: Camera) -> None:
    assert camera.bearings_from_pixels(np.zeros((0, 2))).shape == (0, 3)
    assert camera.blind(np.zeros((0, 2))).shape == (0,)
    pixels, inside = camera.pixels_from_bearings(np.zeros((0, 3)))
    assert pixels.shape == (0, 2)
    assert inside.shape == (0,)


def test_input_is_not_changed_and_raises_no_warning(camera: Camera) -> None:
    pixels, bearings = image_pixels(camera, 5), np.concatenate([np.eye(3), -np.eye(3), np.random.default_rng(5).normal(0, 1, (50, 3))])
    copies = pixels.copy(), bearings.copy()
    with np.errstate(all="raise", under="ignore"):
        camera.bearings_from_pixels(pixels)
        camera.pixels_from_bearings(bearings)
    assert_array_equal(pixels, copies[0])
    assert_array_equal(bearings, copies[1])


def test_equal_cameras_are_equal_keys(camera: Camera) -> None:
    again = pickle.loads(pickle.dumps(camera))
    assert again == camera
    assert hash(again) == hash(camera)
    assert replace(again, height=again.height, width=again.width) == camera


def test_optical_frame_and_camera_frame() -> None:
    # Forward is +z of the optical frame, left −x, up −y; a rotation.
    assert_array_equal(OPTICAL_FROM_CAMERA @ np.eye(3), [[0, -1, 0], [0, 0, -1], [1, 0, 0]])
    assert np.linalg.det(OPTICAL_FROM_CAMERA) == 1
