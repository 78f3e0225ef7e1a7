"""WILDTRACK: round trips of grid, annotations and cameras, and the fit of Tsai's distortion."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from tracker.formats.wildtrack.files import (
    GroundGrid,
    WildtrackPosition,
    opencv_camera,
    read_calibration,
    read_ground_grid,
    read_positions,
    write_calibration,
    write_config,
    write_positions,
)
from tracker.geometry import Pose
from tracker.geometry.cameras import pinhole
from tracker.io.tsai_xml import read_camera

boxes = st.lists(st.tuples(*[st.integers(-1, 4000)] * 4), max_size=7).map(lambda b: np.array(b, dtype=np.int64).reshape(-1, 4))
feet = st.one_of(st.none(), st.tuples(*[st.floats(-100, 100)] * 3).map(np.array))
placed = st.builds(WildtrackPosition, st.one_of(st.integers(0, 9), st.integers(2**31, 2**53 - 1)), st.integers(0, 10**9), boxes, feet)


@settings(max_examples=60, deadline=None)
@given(st.lists(placed, max_size=4))
def test_annotations_round_trip(people: list[WildtrackPosition]) -> None:
    with tempfile.TemporaryDirectory() as folder:
        write_positions(Path(folder) / "0.json", people)
        again = read_positions(Path(folder) / "0.json")
    for a, b in zip(again, people, strict=True):
        assert (a.person, a.position) == (b.person, b.position)
        assert_array_equal(a.boxes, b.boxes)
        assert a.boxes.dtype == np.int64
        assert_array_equal(a.feet, b.feet)


@settings(max_examples=60, deadline=None)
@given(st.lists(st.tuples(st.floats(-50, 50), st.floats(-50, 50)), min_size=1, max_size=8))
def test_positions_round_trip_to_half_a_cell(points: list[tuple[float, float]]) -> None:
    given_ = np.array(points)
    region = GroundGrid.around(given_)
    positions = region.positions(given_)
    assert (positions >= 0).all()
    assert (positions < region.columns * region.rows).all()
    assert np.abs(region.points(positions) - given_).max() <= region.cell / 2 + 1e-9
    assert_array_equal(region.positions(region.points(positions)), positions)
    with tempfile.TemporaryDirectory() as folder:
        write_config(Path(folder) / "config.json", region, 4, 10, (720, 1280))
        again = read_ground_grid(Path(folder) / "config.json")
    assert (again.columns, again.rows, again.cell) == (region.columns, region.rows, region.cell)
    assert_array_equal(again.origin, region.origin)


def test_position_ids_count_along_x_first() -> None:
    """25 × 16 m, 0.025 m, positionID = gx + 1000 gy (FORMATS of the dataset)."""
    region = GroundGrid(np.zeros(2), 1000, 640)
    assert_array_equal(region.positions(np.array([[0, 0], [0.025, 0], [0, 0.025], [24.975, 15.975]])), [0, 1, 1000, 639_999])
    assert_allclose(region.points(np.array([1002])), [[0.05, 0.025]])
    with pytest.raises(ValueError, match=r"point \[25.0, 0.0\] m is outside the region of 1000 x 640 cells"):
        region.positions(np.array([[25.0, 0.0]]))


def test_pinhole_equals_opencv_camera(tmp_path: Path) -> None:
    camera, T = pinhole(320, 240, 1.1), Pose.planar(3, -2, 0.7, 2.5)
    calibrated, error = opencv_camera(camera, T)
    assert error < 1e-9
    write_calibration(tmp_path, "Camera1", calibrated)
    again = read_calibration(tmp_path, "Camera1", (240, 320))
    assert again.camera == calibrated.camera
    points = T.apply(np.random.default_rng(0).uniform([4, -2, -1], [9, 2, 1], (50, 3)))
    pixels = again.camera.pixels_from_bearings(again.pose.inverse().apply(points))[0]
    assert_allclose(pixels, camera.pixels_from_bearings(T.inverse().apply(points))[0], atol=1e-8)


@pytest.mark.parametrize(("view", "bound"), [(1, 0.002), (8, 8.0)])
def test_real_cameras_are_approximated_within_the_stated_error(data: Any, view: int, bound: float) -> None:
    _, camera, T = read_camera(data("pets2009", "calibration", f"View_00{view}.xml"))
    calibrated, error = opencv_camera(camera, T)
    assert error < bound
    pixels = np.random.default_rng(view).uniform([0, 0], [camera.width - 1, camera.height - 1], (300, 2))
    again = calibrated.camera.pixels_from_bearings(camera.bearings_from_pixels(pixels))[0]
    assert np.linalg.norm(again - pixels, axis=1).max() < 1.1 * error + 1e-6


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('[{"personID": 1, "views": []}]', "positionID is missing"),
        (
            '[{"personID": 1, "positionID": 0, "views": [{"viewNum": 1, "xmin": 0, "ymin": 0, "xmax": 0, "ymax": 0}]}]',
            r"people\[0\]: views are not numbered",
        ),
        ("[3]", r"people\[0\]: a JSON int, needs an object"),
        ("{}", "people is dict, needs list"),
    ],
)
def test_invalid_annotation_is_refused(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "0.json").write_text(text)
    with pytest.raises(ValueError, match=f"0.json: .*{message}"):
        read_positions(tmp_path / "0.json")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("<rvec>3</rvec>", r"line 3: rvec has shape \(1, 1\), needs 3 numbers"),
        ("<rvec>0 0 up</rvec>", "line 3: rvec is 'up', needs a number"),
    ],
)
def test_invalid_calibrations_are_refused(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(ValueError, match=r"intr_Camera1\.xml: no such file"):
        read_calibration(tmp_path, "Camera1", (240, 320))
    write_calibration(tmp_path, "Camera1", opencv_camera(pinhole(320, 240, 1.1), Pose.identity())[0])
    (tmp_path / "extrinsic" / "extr_Camera1.xml").write_text(f'<?xml version="1.0"?>\n<opencv_storage>\n{text}</opencv_storage>\n')
    with pytest.raises(ValueError, match=rf"extr_Camera1\.xml:{message}"):
        read_calibration(tmp_path, "Camera1", (240, 320))


def test_an_empty_grid_is_refused(tmp_path: Path) -> None:
    (tmp_path / "config.json").write_text('{"grid_shape": [0, 4], "origin": [0, 0], "grid_cell": 0.1}')
    with pytest.raises(ValueError, match=r"config.json: region is 4 x 0 cells"):
        read_ground_grid(tmp_path / "config.json")
