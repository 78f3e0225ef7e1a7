"""Perspective views from panoramas keep directions, have a level horizon, and agree with their camera file."""

from pathlib import Path

import numpy as np
import pytest

from tests.tracker.perspective_views import ViewDirection, rectify
from tracker.formats.pets2009 import read_camera, write_camera
from tracker.geometry import Pose, angles_from_bearing
from tracker.geometry.cameras import Panorama

PANORAMA = Panorama(1024, 512)
LEANING = Pose.planar(4.0, -2.0, 0.7, 1.5) @ Pose.exp([0, 0, 0, 0.15, -0.1, 0.0])


def marked(pose: Pose, points: np.ndarray) -> np.ndarray:
    """A panorama in which the i-th point (world) is a blob of value i + 1, 5 px wide."""
    image = np.zeros((512, 1024), np.uint16)
    pixels, _ = PANORAMA.pixels_from_bearings(pose.inverse().apply(points))
    for k, (u, v) in enumerate(pixels):
        columns = (int(u) + np.arange(-2, 3)) % 1024
        image[int(v) - 2 : int(v) + 3, columns] = k + 1
    return image


@pytest.mark.parametrize("azimuth", [0.0, 0.5 * np.pi, -np.pi / 2, 0.7 + np.pi, 2.2])
def test_a_point_projected_by_the_file_lands_on_its_mark(azimuth: float, tmp_path: Path) -> None:
    # All azimuths of the world, that of the seam (0.7 + π) among them; along x and −x the file's three angles are at their singular place.
    rng = np.random.default_rng(3)
    spread = azimuth + rng.uniform(-0.6, 0.6, 12)
    reach = rng.uniform(3.0, 12.0, 12)
    around = LEANING.translation + np.column_stack([reach * np.cos(spread), reach * np.sin(spread), rng.uniform(-1.5, 1.5, 12)])
    # Points on the rays of pixel centres, so that marks are not off by the rounding to pixels.
    snapped = np.floor(PANORAMA.pixels_from_bearings(LEANING.inverse().apply(around))[0]) + 0.5
    points = LEANING.apply(reach[:, None] * PANORAMA.bearings_from_pixels(snapped))
    view = rectify(PANORAMA, LEANING, ViewDirection(azimuth, np.deg2rad(90), (640, 480)))
    write_camera(tmp_path / "v.xml", "v", view.camera, view.T_world_camera)
    _, camera, T_world_camera = read_camera(tmp_path / "v.xml")
    pixels, inside = camera.pixels_from_bearings(T_world_camera.inverse().apply(points))
    assert inside.all()
    for k in range(len(points)):
        # Alone in its panorama: points may hide each other.
        image = view.nearest(marked(LEANING, points[k : k + 1]))
        rows, columns = np.nonzero(image)
        assert np.hypot(columns.mean() - pixels[k, 0], rows.mean() - pixels[k, 1]) < 0.6


def test_the_horizon_is_level() -> None:
    view = rectify(PANORAMA, LEANING, ViewDirection(1.0, 1.2, (321, 241)))
    middle = np.column_stack([np.arange(321.0), np.full(321, 120.0)])
    bearings = view.camera.bearings_from_pixels(middle) @ view.T_world_camera.rotation.T
    np.testing.assert_allclose(bearings[:, 2], 0.0, atol=1e-12)
    azimuth, _ = angles_from_bearing(bearings[160])
    assert azimuth == pytest.approx(1.0)
    spans = angles_from_bearing(view.camera.bearings_from_pixels([[-0.5, 120.0], [320.5, 120.0]]))[0]
    assert spans[0] - spans[1] == pytest.approx(1.2)


def test_colours_are_those_of_the_directions_across_the_seam() -> None:
    # Colour that is linear in the direction: red grows with x, green with y, blue with z of the world.
    u, v = np.meshgrid(np.arange(1024) + 0.5, np.arange(512) + 0.5)
    world = PANORAMA.bearings_from_pixels(np.stack([u.ravel(), v.ravel()], axis=1)) @ LEANING.rotation.T
    image = (127.5 + 127 * world).reshape(512, 1024, 3).astype(np.uint8)
    for azimuth in (0.7, 0.7 + np.pi):
        view = rectify(PANORAMA, LEANING, ViewDirection(azimuth, 1.5, (200, 150)))
        u, v = np.meshgrid(np.arange(200.0), np.arange(150.0))
        expected = 127.5 + 127 * view.camera.bearings_from_pixels(np.stack([u.ravel(), v.ravel()], axis=1)) @ view.T_world_camera.rotation.T
        assert np.abs(view.colour(image).reshape(-1, 3) - expected).max() < 2.0


def test_a_panorama_of_another_size_is_refused() -> None:
    view = rectify(PANORAMA, LEANING, ViewDirection(0.7 + np.pi, 1.2, (64, 48)))
    with pytest.raises(ValueError, match=r"panorama is 512 x 256 px, needs the size"):
        view.nearest(np.zeros((256, 512)))
    with pytest.raises(ValueError, match=r"field of view is 3\.2 rad"):
        rectify(PANORAMA, LEANING, ViewDirection(0.0, 3.2, (64, 48)))
