"""OpenCV's pinhole and fisheye: OpenCV itself as the oracle, fields of more than 180°, folds, and invalid parameters."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from tests.tracker.geometry.random_cameras import image_pixels, random_camera
from tracker.geometry import Array
from tracker.geometry.cameras import OPTICAL_FROM_CAMERA, Fisheye, LensCamera, Pinhole
from tracker.geometry.lenses import fold_of, grown_root

NOWHERE = np.zeros(3)
SEEDS = range(25)


def pinhole(*distortion: float, focal: float = 1000.0) -> Pinhole:
    return Pinhole(1920, 1080, focal, focal, 960.0, 540.0, distortion)


def optical(camera: LensCamera, pixels: Array) -> Array:
    """Directions (n, 3) of pixels in the optical frame."""
    return np.asarray(camera.bearings_from_pixels(pixels) @ OPTICAL_FROM_CAMERA.T)


# --- OpenCV as the oracle ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", SEEDS)
def test_pinhole_projects_as_opencv_does(seed: int) -> None:
    camera = random_camera("pinhole", seed)
    assert isinstance(camera, Pinhole)
    pixels = image_pixels(camera, seed)
    points = optical(camera, pixels) * np.random.default_rng(seed).uniform(0.5, 50.0, (len(pixels), 1))
    projected = cv2.projectPoints(points, NOWHERE, NOWHERE, camera.matrix, np.array(camera.distortion))[0].reshape(-1, 2)
    assert_allclose(camera.pixels_from_bearings(points @ OPTICAL_FROM_CAMERA)[0], projected, atol=1e-8)


@pytest.mark.parametrize("seed", SEEDS)
def test_fisheye_projects_and_undistorts_as_opencv_does_up_to_90_degrees(seed: int) -> None:
    camera = random_camera("fisheye", seed)
    assert isinstance(camera, Fisheye)
    pixels = image_pixels(camera, seed)
    rays = optical(camera, pixels)
    pixels, rays = pixels[rays[:, 2] > 0.02], rays[rays[:, 2] > 0.02]
    distortion = np.array(camera.distortion)
    projected = cv2.fisheye.projectPoints(rays[:, None], NOWHERE, NOWHERE, camera.matrix, distortion)[0].reshape(-1, 2)
    assert_allclose(camera.pixels_from_bearings(rays @ OPTICAL_FROM_CAMERA)[0], projected, atol=1e-8)
    plane = cv2.fisheye.undistortPoints(pixels[:, None], camera.matrix, distortion, criteria=(3, 100, 1e-14)).reshape(-1, 2)
    # OpenCV cuts off distorted radii beyond π/2, and marks what it does not solve with −1,000,000.
    radius = np.hypot(*((pixels - [camera.cx, camera.cy]) / [camera.fx, camera.fy]).T)
    known = (radius < np.pi / 2) & (np.abs(plane) < 1e5).all(axis=1)
    assert known.mean() > 0.5
    ideal = np.column_stack([plane, np.ones(len(plane))])[known]
    assert_allclose(rays[known], ideal / np.linalg.norm(ideal, axis=1, keepdims=True), atol=1e-7)


# --- the fisheye beyond 180° ------------------------------------------------------------------------------------------------------


def test_fisheye_without_distortion_is_equidistant_up_to_its_rear() -> None:
    camera = Fisheye(1000, 1000, 150.0, 150.0, 499.5, 499.5)
    angle = np.radians([0.0, 45, 90, 120, 170])
    # To the right: y of the camera's frame is negative.
    bearings = np.column_stack([np.cos(angle), -np.sin(angle), np.zeros(5)])
    pixels, inside = camera.pixels_from_bearings(bearings)
    assert inside.all()
    assert_allclose(pixels, np.column_stack([499.5 + 150 * angle, np.full(5, 499.5)]))
    assert_allclose(camera.bearings_from_pixels(pixels), bearings, atol=1e-12)
    behind, inside = camera.pixels_from_bearings([[-1.0, 0, 0]])
    assert np.isnan(behind).all()
    assert not inside.any()
    # 150 px a radian: 180° from the axis is 471 px from the middle.
    assert_array_equal(camera.blind([[499.5 + 471, 499.5], [499.5 + 472, 499.5], [0, 0]]), [False, True, True])


def test_directions_beyond_the_fold_of_a_fisheye_are_out_of_view() -> None:
    # θ (1 − 0.08 θ²) grows up to θ = 1 / √0.24 = 117°. The corners of the image are beyond it, and blind.
    camera = Fisheye(1000, 1000, 400.0, 400.0, 499.5, 499.5, (-0.08, 0.0, 0.0, 0.0))
    assert camera.fold == pytest.approx(1 / np.sqrt(0.24))
    angle = camera.fold + np.array([-0.5, -1e-3, 1e-3, 0.5])
    pixels, inside = camera.pixels_from_bearings(np.column_stack([np.cos(angle), np.sin(angle), np.zeros(4)]))
    assert_array_equal(np.isnan(pixels).all(axis=1), [False, False, True, True])
    assert not inside[2:].any()
    edge = 400 * camera.fold * (1 - 0.08 * camera.fold**2)
    assert_array_equal(camera.blind([[499.5 - edge + 0.1, 499.5], [499.5 - edge - 0.1, 499.5], [0, 0]]), [False, True, True])


# --- folds ------------------------------------------------------------------------------------------------------------------------


def test_fold_is_where_the_radial_map_stops_growing() -> None:
    assert fold_of((-0.3,)) == pytest.approx(1 / np.sqrt(0.9))
    assert fold_of((0.3, 0.1, 0.2)) == np.inf
    assert fold_of(()) == np.inf
    for seed in range(50):
        k = tuple(np.random.default_rng(seed).normal(0.0, [0.4, 0.2, 0.1]))
        r = np.linspace(0.0, 20.0, 400_001)
        growing = np.diff(r * (1 + k[0] * r**2 + k[1] * r**4 + k[2] * r**6)) > 0
        brute = np.inf if growing.all() else r[int(np.argmin(growing))]
        assert fold_of(k) == pytest.approx(brute, abs=2e-4) or (fold_of(k) > 20 and brute == np.inf)


def test_root_is_found_next_to_the_fold_and_far_beyond_the_image() -> None:
    for k in ((-0.3, 0.0, 0.0), (-0.3, 0.12, 0.05), (0.2, 0.1, 0.05)):
        fold = fold_of(k)
        r = np.concatenate([np.linspace(0.0, min(fold, 400.0), 1001), min(fold, 1.0) * (1 - np.logspace(-12, -1, 12))])
        value = r * (1 + k[0] * r**2 + k[1] * r**4 + k[2] * r**6)
        root, solved = grown_root(k, value, fold)
        assert solved[np.arange(len(r)) != 1000].all()
        assert_allclose(root * (1 + k[0] * root**2 + k[1] * root**4 + k[2] * root**6), value, rtol=1e-14, atol=1e-14)


def test_tangential_distortion_is_one_to_one_within_the_fold() -> None:
    camera = pinhole(-0.2, 0.0, 0.02, -0.015, 0.0, focal=2200.0)
    angle = np.linspace(-np.pi, np.pi, 721)

    def distorted(points: Array) -> Array:
        """OpenCV's own projection at focal length 1."""
        there = np.column_stack([points, np.ones(len(points))])
        return np.asarray(cv2.projectPoints(there, NOWHERE, NOWHERE, np.eye(3), np.array(camera.distortion))[0].reshape(-1, 2))

    def determinant(radius: float) -> Array:
        """Of the Jacobian, by differences."""
        points = radius * np.column_stack([np.cos(angle), np.sin(angle)])
        by_x, by_y = ((distorted(points + step) - distorted(points - step)) / 2e-6 for step in 1e-6 * np.eye(2))
        return np.asarray(by_x[:, 0] * by_y[:, 1] - by_x[:, 1] * by_y[:, 0])

    assert determinant(0.995 * camera.fold).min() > 0
    assert determinant(1.005 * camera.fold).min() < 0


@pytest.mark.parametrize(
    ("make", "text"),
    [
        # Grows up to r = 1 / √0.9 = 1.054, where the distorted radius is 0.703: 703 px; the corner is at 1101 px.
        (lambda: pinhole(-0.3, 0.0, 0.0, 0.0, 0.0), r"folds within the image: 703 px from \(cx, cy\), while the pixel \(0, 0\) is 1102 px from it"),
        (lambda: pinhole(-0.3, 0.0, 0.001, 0.001, 0.0), r"folds within the image: \d{3} px from \(cx, cy\), while the pixel"),
        (lambda: Fisheye(1920, 1080, 700.0, 700.0, 960.0, 540.0, (-0.2, 0.0, 0.0, 0.0)), r"folds within the image: 602 px"),
        (lambda: pinhole(0.1, 0.0, 0.0, 0.0), "needs 5 numbers of at most 1e.06 in size: k1, k2, p1, p2, k3"),
        (lambda: pinhole(0.1, 0.0, 0.0, 0.0, float("nan")), "distortion is .*nan.*, needs 5 numbers"),
        (lambda: pinhole(0.1, 0.0, 0.0, 0.0, 1e300), "distortion is .*1e.300.*, needs 5 numbers"),
        (lambda: Fisheye(640, 480, 300.0, 300.0, 320.0, 240.0, (0.0,) * 5), "needs 4 numbers of at most 1e.06 in size: k1, k2, k3, k4"),
        (lambda: Pinhole(0, 480, 300.0, 300.0, 320.0, 240.0), "image size is 0 x 480"),
        (lambda: Pinhole(640, 480, 0.0, 300.0, 320.0, 240.0), "fx is 0.0 px, needs 0.001 to 1e.09"),
        (lambda: Pinhole(640, 480, 300.0, float("nan"), 320.0, 240.0), "fy is nan px, needs 0.001 to 1e.09"),
        (lambda: Pinhole(640, 480, 300.0, 300.0, float("inf"), 240.0), "cx is inf px, needs at most 1e.09 in size"),
    ],
)
def test_lenses_are_checked(make: Any, text: str) -> None:
    with pytest.raises(ValueError, match=text):
        make()


def test_fold_is_refused_exactly_from_where_a_corner_reaches_it() -> None:
    # The corner of this image is at (960.5, 540.5) px from the principal point, which is 1102.1 px.
    corner, k1 = np.hypot(959.5 + 1, 539.5 + 1), -0.3
    fold = 1 / np.sqrt(0.9)
    focal = corner / (fold * (1 + k1 * fold**2))
    pinhole(k1, 0.0, 0.0, 0.0, 0.0, focal=1.0001 * focal)
    with pytest.raises(ValueError, match="folds within the image"):
        pinhole(k1, 0.0, 0.0, 0.0, 0.0, focal=0.9999 * focal)
