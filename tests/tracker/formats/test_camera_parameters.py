"""Parameters of cameras for other formats, and views as pinholes."""

import cv2
import numpy as np
import pytest
from numpy.testing import assert_allclose

from tracker.formats.camera_parameters import CameraParameters, faces, pixel_errors, straight
from tracker.geometry.cameras import OPTICAL_FROM_CAMERA, Camera, Cylinder, Fisheye, Panorama, Pinhole, Tsai, pinhole

PETS = Tsai(768, 576, 5.5549, 5.1113e-03, 324.22, 282.57, 1.09379, 5.1273e-03, 4.65e-03)
"""View_001 of PETS 2009."""


def test_the_error_of_a_fitted_distortion_is_stated() -> None:
    """No pixel of a grid is farther from OpenCV's projection than the stated error."""
    p = CameraParameters.of(PETS)
    u, v = np.meshgrid(np.arange(0, 768, 13.0), np.arange(0, 576, 13.0))
    pixels = np.column_stack([u.ravel(), v.ravel()])
    K = np.array([[p.fx, 0, p.cx], [0, p.fy, p.cy], [0, 0, 1]])
    optical = PETS.bearings_from_pixels(pixels) @ OPTICAL_FROM_CAMERA.T
    again = cv2.projectPoints(optical, np.zeros(3), np.zeros(3), K, np.array(p.distortion))[0].reshape(-1, 2)
    assert 0 < np.linalg.norm(again - pixels, axis=1).max() <= p.error * 1.01 < 0.5
    assert pixel_errors({"View_001": PETS, "other": pinhole(320, 240, 1.2)}) == [f"View_001: its distortion is fitted to {p.error:.2g} px"]


@pytest.mark.parametrize("camera", [PETS, Pinhole(320, 240, 250.0, 250.0, 160.0, 120.0, (-0.2, 0.02, 0.0, 0.0, 0.0))])
def test_a_distorted_view_becomes_a_pinhole(camera: Camera) -> None:
    view, p = straight("c", camera), CameraParameters.of(camera)
    assert isinstance(view.camera, Pinhole)
    assert not any(view.camera.distortion)
    assert_allclose((view.camera.fx, view.camera.fy, view.camera.cx, view.camera.cy), p.intrinsics)
    assert view.resampling is not None


def test_a_plain_pinhole_stays_as_it_is() -> None:
    camera = pinhole(320, 240, 1.2)
    for view in (straight("c", camera), *faces("c", camera)):
        assert view.resampling is None
        assert view.camera is camera


def test_names_of_faces() -> None:
    assert [v.name for v in faces("c", Panorama(64, 32))] == ["c_front", "c_left", "c_back", "c_right", "c_up", "c_down"]
    assert [v.name for v in faces("c", Cylinder(64, 16, 8.0, 10.0))] == ["c_front", "c_left", "c_back", "c_right"]
    fisheye = Fisheye(64, 64, 20.0, 20.0, 31.5, 31.5, (0.0, 0.0, 0.0, 0.0))
    assert [v.camera for v in faces("c", fisheye)] == [fisheye]
