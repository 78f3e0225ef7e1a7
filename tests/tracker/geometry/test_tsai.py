"""Tsai's camera: its distortion, directions without a pixel, pixels beyond the fold, invalid parameters, and the parameters of other models."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from tests.tracker.geometry.random_cameras import image_pixels
from tests.tracker.geometry.test_cameras import BARREL, VIEW_001, VIEW_007
from tracker.geometry.cameras import Pinhole, Tsai
from tracker.geometry.tsai import tsai_of

PINHOLE = Tsai(640, 480, 4.0, 0.0, 320.0, 240.0, 1.0, 5e-3, 5e-3)


def fold(camera: Tsai) -> float:
    """The radius on the sensor, mm, beyond which κ1 < 0 folds back."""
    return float(np.sqrt(-1 / (3 * camera.kappa1)))


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


@pytest.mark.parametrize(
    ("make", "text"),
    [
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


def test_pinhole_without_distortion_is_a_tsai_camera() -> None:
    camera = Pinhole(640, 480, 801.0, 795.0, 322.0, 236.0)
    same = tsai_of(camera)
    pixels = image_pixels(camera, 1)
    assert_allclose(same.bearings_from_pixels(pixels), camera.bearings_from_pixels(pixels), atol=1e-14)
    assert tsai_of(BARREL) is BARREL


def test_opencv_distortion_has_no_tsai_camera() -> None:
    with pytest.raises(ValueError, match="needs Tsai's model or a pinhole without distortion"):
        tsai_of(Pinhole(640, 480, 801.0, 795.0, 322.0, 236.0, (-0.1, 0.0, 0.0, 0.0, 0.0)))
    assert isinstance(tsai_of(VIEW_001), Tsai)
