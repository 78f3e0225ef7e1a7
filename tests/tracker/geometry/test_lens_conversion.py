"""Cameras in the parameters of another model."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from tests.tracker.geometry.random_cameras import image_pixels
from tests.tracker.geometry.test_cameras import BARREL, VIEW_001
from tracker.geometry.cameras import Fisheye, Panorama, Pinhole, Tsai
from tracker.geometry.tsai import opencv_intrinsics, tsai_of


def test_pinhole_has_its_own_parameters() -> None:
    camera = Pinhole(1920, 1080, 1100.0, 1095.0, 965.0, 532.0, (-0.32, 0.14, 0.002, -0.003, -0.02))
    matrix, distortion, error = opencv_intrinsics(camera)
    assert matrix.tolist() == [[1100, 0, 965], [0, 1095, 532], [0, 0, 1]]
    assert tuple(distortion) == camera.distortion
    assert error == 0


def test_error_of_a_fitted_distortion_is_that_over_the_image() -> None:
    (fx, _, cx), (_, fy, cy), _ = opencv_intrinsics(VIEW_001)[0].tolist()
    distortion, error = opencv_intrinsics(VIEW_001)[1:]
    fitted = Pinhole(VIEW_001.width, VIEW_001.height, fx, fy, cx, cy, tuple(distortion))
    pixels = image_pixels(fitted, 0)
    pixels = pixels[((pixels >= 0) & (pixels <= [767, 575])).all(axis=1)]
    again, _ = fitted.pixels_from_bearings(VIEW_001.bearings_from_pixels(pixels))
    assert 0 < error < 0.002
    assert np.linalg.norm(again - pixels, axis=1).max() <= 1.05 * error


def test_pinhole_without_distortion_is_a_tsai_camera() -> None:
    camera = Pinhole(640, 480, 801.0, 795.0, 322.0, 236.0)
    same = tsai_of(camera)
    pixels = image_pixels(camera, 1)
    assert_allclose(same.bearings_from_pixels(pixels), camera.bearings_from_pixels(pixels), atol=1e-14)
    assert tsai_of(BARREL) is BARREL


@pytest.mark.parametrize("camera", [Panorama(64, 32), Fisheye(640, 480, 300.0, 300.0, 320.0, 240.0)])
def test_other_models_are_no_pinholes(camera: Panorama | Fisheye) -> None:
    with pytest.raises(ValueError, match=f"camera is a {type(camera).__name__}, needs a pinhole"):
        opencv_intrinsics(camera)
    with pytest.raises(ValueError, match="needs Tsai's model or a pinhole without distortion"):
        tsai_of(camera)


def test_opencv_distortion_has_no_tsai_camera() -> None:
    with pytest.raises(ValueError, match="needs Tsai's model or a pinhole without distortion"):
        tsai_of(Pinhole(640, 480, 801.0, 795.0, 322.0, 236.0, (-0.1, 0.0, 0.0, 0.0, 0.0)))
    assert isinstance(tsai_of(VIEW_001), Tsai)
