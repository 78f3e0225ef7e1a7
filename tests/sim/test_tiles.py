"""Tiles of a height field against MuJoCo's own surface."""

import numpy as np
import pytest

from sim.tiles import CELLS, tiles_of
from tests.sim.scenes import HALF, Scene, court


@pytest.fixture(scope="module")
def scene() -> Scene:
    return court()


def test_tiles_are_the_whole_surface_once(scene: Scene) -> None:
    tiles = tiles_of(scene.model, 0)
    assert len(tiles) == int(np.ceil(60 / CELLS)) ** 2
    corners, normals = (np.concatenate([getattr(tile, name) for tile in tiles]) for name in ("corners", "normals"))
    assert len(corners) == 60 * 60 * 2 + 4 * 60 * 2
    np.testing.assert_array_equal(normals[:, 0], normals[:, 2])
    above = normals[:, 0, 2] > 1e-3
    area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[above, 2].sum() / 2
    assert area == pytest.approx((2 * HALF) ** 2, rel=1e-5)
    # The sides of the solid look outwards.
    outwards = corners[~above].mean(axis=1)
    assert ((outwards * normals[~above, 0])[:, :2].sum(axis=1) > 0).all()


def test_boxes_hold_their_triangles(scene: Scene) -> None:
    for tile in tiles_of(scene.model, 0):
        assert (np.abs(tile.corners - tile.box[:3]) <= tile.box[3:] + 1e-6).all()
