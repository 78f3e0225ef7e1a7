"""Panoramic cameras: the equirectangular panorama and the cylinder, their formulas and seams, and invalid parameters."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from tracker.geometry import angles_from_bearing
from tracker.geometry.cameras import Cylinder, Panorama

JRDB = Cylinder(3760, 480, 210.7, 481.0)


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


def test_feet_on_the_floor_are_at_the_row_of_the_range_in_a_cylinder() -> None:
    # JRDB: v = 210.7 + 481 · eye height / range. The eye is 1 m above the floor, a person is 4 m ahead on the left.
    ((u, v),), inside = JRDB.pixels_from_bearings([[4 * np.cos(0.5), 4 * np.sin(0.5), -1.0]])
    assert inside.all()
    assert v == pytest.approx(210.7 + 481 / 4)
    assert u == pytest.approx(3760 * (np.pi - 0.5) / (2 * np.pi))


def test_vertical_directions_have_no_pixel_in_a_cylinder() -> None:
    pixels, inside = JRDB.pixels_from_bearings([[0, 0, 1.0], [0, 0, -1.0], [1, 0, 5.0], [1, 0, -5.0]])
    assert not inside.any()
    assert_array_equal(np.isnan(pixels).all(axis=1), [True, True, False, False])


@pytest.mark.parametrize(
    ("make", "text"),
    [
        (lambda: Panorama(100, 60), "needs width = 2 height"),
        (lambda: Panorama(0, 0), "image size is 0 x 0"),
        (lambda: Cylinder(0, 480, 210.0, 481.0), "image size is 0 x 480"),
        (lambda: Cylinder(3760, 480, float("nan"), 481.0), "horizon is nan, needs a finite number"),
        (lambda: Cylinder(3760, 480, 210.0, 0.0), "focal is 0.0, needs more than 0"),
        (lambda: Cylinder(3760, 480, 210.0, float("inf")), "focal is inf, needs more than 0"),
    ],
)
def test_panoramas_are_checked(make: Any, text: str) -> None:
    with pytest.raises(ValueError, match=text):
        make()
