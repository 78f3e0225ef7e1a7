"""rectangles.pom: a cylinder in front of a simple camera."""

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from tracker.formats.wildtrack.files import GroundGrid, OpenCvCamera
from tracker.formats.wildtrack.rectangles import HEIGHT, RADIUS, rectangles, write_rectangles

SIZE = (400, 600)


def read_rectangles(path: Path, cameras: int, cells: int) -> np.ndarray:
    """The boxes (cameras, cells, 4) px of a file; all four are −1 where the cell is not visible."""
    found = np.full((cameras, cells, 4), -2)
    for line in path.read_text().splitlines():
        word, camera, cell, *edges = line.split()
        assert word == "RECTANGLE"
        found[int(camera), int(cell)] = -1 if edges == ["notvisible"] else [int(edge) for edge in edges]
    assert (found[..., 0] > -2).all()
    return found


def camera() -> OpenCvCamera:
    """At the origin, 1 m up, level, along x: 500 px of focal length, the axis through (300, 200)."""
    matrix = np.array([[500.0, 0.0, 300.0], [0.0, 500.0, 200.0], [0.0, 0.0, 1.0]])
    rotation = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
    # The rotation by 120 degrees that takes x to z, y to -x and z to -y.
    axis = np.array([rotation[2, 1] - rotation[1, 2], rotation[0, 2] - rotation[2, 0], rotation[1, 0] - rotation[0, 1]])
    rvec = axis / np.linalg.norm(axis) * np.arccos((np.trace(rotation) - 1) / 2)
    return OpenCvCamera(matrix, np.zeros(5), rvec, -rotation @ np.array([0.0, 0.0, 1.0]))


def test_box_of_a_person_ahead_follows_perspective() -> None:
    (left, top, right, bottom), behind, aside = rectangles(camera(), np.array([[10.0, 0, 0], [-10.0, 0, 0], [10.0, 9.0, 0]]), SIZE)
    near = 10.0 - RADIUS
    assert bottom == np.ceil(200 + 500 * 1.0 / near)
    assert top == np.floor(200 - 500 * (HEIGHT - 1.0) / near)
    assert left == pytest.approx(300 - 500 * RADIUS / 10.0, abs=1.5)
    assert right == pytest.approx(300 + 500 * RADIUS / 10.0, abs=1.5)
    assert (behind == -1).all()
    assert (aside == -1).all()


def test_boxes_are_clipped_to_the_image() -> None:
    edges = rectangles(camera(), np.array([[1.0, 0.0, 0.0], [10.0, 6.0, 0.0]]), SIZE)
    assert edges[0, 3] == SIZE[0] - 1
    assert edges[0, 1] == 0
    assert edges[1, 0] == 0
    assert 0 <= edges[1, 2] < 20


def test_rectangles_round_trip(tmp_path: Path) -> None:
    region = GroundGrid(np.array([2.0, -2.0]), 40, 160, 0.1)
    turned = OpenCvCamera(camera().matrix, np.zeros(5), camera().rvec, camera().tvec + np.array([0.5, 0.0, 0.0]))
    write_rectangles(tmp_path / "rectangles.pom", region, [camera(), turned], SIZE, lambda points: 0.1 * points[:, 0])
    found = read_rectangles(tmp_path / "rectangles.pom", 2, 40 * 160)
    places = region.points(np.arange(40 * 160))
    feet = np.column_stack([places, 0.1 * places[:, 0]])
    assert_array_equal(found, [rectangles(one, feet, SIZE) for one in (camera(), turned)])
    assert (found[0] >= 0).all(axis=1).any()
    assert (found[0] == -1).all(axis=1).any()
