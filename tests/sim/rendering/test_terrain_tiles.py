"""Tiles of a height field against MuJoCo's own surface."""

import numpy as np
import pytest

from sim.rendering.geometry import CELLS, tiles_of
from tests.sim.scenes import HALF, Scene, court


@pytest.fixture(scope="module")
def scene() -> Scene:
    return court()


def test_tiles_are_the_whole_surface_once(scene: Scene) -> None:
    tiles = tiles_of(scene.model, 0)
    assert len(tiles) == int(np.ceil(60 / CELLS)) ** 2
    corners = np.concatenate([tile.points[tile.triangles] for tile in tiles])
    # Of a triangle that is lit flat, the last corner's counts.
    normals = np.concatenate([tile.normals[tile.triangles[:, 2]] for tile in tiles])
    assert len(corners) == 60 * 60 * 2 + 4 * 60 * 2
    facing = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    np.testing.assert_allclose(normals, facing / np.linalg.norm(facing, axis=1, keepdims=True), atol=1e-5)
    above = normals[:, 2] > 1e-3
    area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[above, 2].sum() / 2
    assert area == pytest.approx((2 * HALF) ** 2, rel=1e-5)
    # The sides of the solid look outwards.
    outwards = corners[~above].mean(axis=1)
    assert ((outwards * normals[~above])[:, :2].sum(axis=1) > 0).all()


def test_boxes_hold_their_triangles(scene: Scene) -> None:
    for tile in tiles_of(scene.model, 0):
        assert (np.abs(tile.points - tile.box[:3]) <= tile.box[3:] + 1e-6).all()


def test_most_corners_serve_several_triangles(scene: Scene) -> None:
    for tile in tiles_of(scene.model, 0):
        last = tile.triangles[:, 2]
        assert len(np.unique(last)) == len(last)
        assert len(tile.points) < 1.6 * len(tile.triangles)
