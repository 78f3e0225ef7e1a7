"""rectangles.pom: a cylinder in front of a simple camera."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from tracker.formats.wildtrack.export import HEIGHT, RADIUS, rectangles, write_rectangles
from tracker.formats.wildtrack.files import GroundGrid
from tracker.geometry import Pose
from tracker.geometry.cameras import Pinhole
from tracker.recordings import RecordingCamera


def read_rectangles(path: Path, cameras: int, cells: int) -> np.ndarray:
    """The boxes (cameras, cells, 4) px of a file; all four are −1 where the cell is not visible."""
    found = np.full((cameras, cells, 4), -2)
    for line in path.read_text().splitlines():
        word, camera, cell, *edges = line.split()
        assert word == "RECTANGLE"
        found[int(camera), int(cell)] = -1 if edges == ["notvisible"] else [int(edge) for edge in edges]
    assert (found[..., 0] > -2).all()
    return found


CAMERA = RecordingCamera.looking_at(Pinhole(600, 400, 500.0, 500.0, 300.0, 200.0), [0.0, 0.0, 1.0], [1.0, 0.0, 1.0])
"""At the origin, 1 m up, level, along x."""


def test_box_of_a_person_ahead_follows_perspective() -> None:
    (left, top, right, bottom), behind, aside = rectangles(CAMERA, np.array([[10.0, 0, 0], [-10.0, 0, 0], [10.0, 9.0, 0]]))
    near = 10.0 - RADIUS
    assert bottom == np.ceil(200 + 500 * 1.0 / near)
    assert top == np.floor(200 - 500 * (HEIGHT - 1.0) / near)
    assert left == pytest.approx(300 - 500 * RADIUS / 10.0, abs=1.5)
    assert right == pytest.approx(300 + 500 * RADIUS / 10.0, abs=1.5)
    assert (behind == -1).all()
    assert (aside == -1).all()


def test_boxes_are_clipped_to_the_image() -> None:
    edges = rectangles(CAMERA, np.array([[1.0, 0.0, 0.0], [10.0, 6.0, 0.0]]))
    assert edges[0, 3] == 399
    assert edges[0, 1] == 0
    assert edges[1, 0] == 0
    assert 0 <= edges[1, 2] < 20


def test_rectangles_round_trip(tmp_path: Path) -> None:
    region = GroundGrid(np.array([2.0, -2.0]), 40, 160, 0.1)
    beside = replace(CAMERA, pose=Pose(CAMERA.pose.rotation, np.array([0.0, 0.5, 1.0])))
    write_rectangles(tmp_path / "rectangles.pom", region, [CAMERA, beside], lambda points: 0.1 * points[:, 0])
    found = read_rectangles(tmp_path / "rectangles.pom", 2, 40 * 160)
    places = region.points(np.arange(40 * 160))
    feet = np.column_stack([places, 0.1 * places[:, 0]])
    assert_array_equal(found, [rectangles(one, feet) for one in (CAMERA, beside)])
    assert (found[0] >= 0).all(axis=1).any()
    assert (found[0] == -1).all(axis=1).any()
