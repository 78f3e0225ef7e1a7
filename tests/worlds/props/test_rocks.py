"""Boulders and stones: closed, convex and of the size asked for."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from worlds.props.meshes import boulder, stone_sizes
from worlds.props.shapes import Shape


def _solid(shape: Shape) -> trimesh.Trimesh:
    """The mesh with its corners joined again."""
    return trimesh.Trimesh(shape.vertices, shape.faces, process=True)


@pytest.mark.parametrize("seed", range(5))
def test_a_boulder_collides_as_it_looks(seed: int) -> None:
    solid = _solid(boulder(np.random.default_rng(seed), (0.8, 0.6, 0.4)))
    assert solid.is_watertight
    assert solid.volume > 0
    np.testing.assert_allclose(solid.volume, solid.convex_hull.volume, rtol=1e-9)
    assert len(solid.faces) <= 120


@pytest.mark.parametrize("seed", range(5))
def test_a_boulder_is_as_large_as_asked(seed: int) -> None:
    size = np.array([0.8, 0.6, 0.4])
    vertices = boulder(np.random.default_rng(seed), size).vertices
    assert (np.linalg.norm(vertices / size, axis=1) <= 1 + 1e-9).all()
    assert (np.ptp(vertices, axis=0) >= size).all()


def test_boulders_differ_and_come_again() -> None:
    once, again, other = (boulder(np.random.default_rng(seed), (1, 1, 1)).vertices for seed in (0, 0, 1))
    np.testing.assert_array_equal(once, again)
    assert once.shape != other.shape or not np.allclose(once, other)


def test_stones_are_many_small_and_few_large() -> None:
    sizes = stone_sizes(np.random.default_rng(0), 4000, 0.1, 1.0)
    assert sizes.shape == (4000, 3)
    assert sizes[:, :2].min() >= 0.075
    assert sizes[:, :2].max() <= 1.25
    assert sizes[:, 2].max() <= 0.75 * 1.25
    # The law says P(s > x) = (x⁻² − 1) / 99 for least 0.1 and most 1; the mean over the unevenness of ± 25 % is near to it.
    mean = sizes[:, :2].mean(axis=1)
    for x in (0.2, 0.4):
        np.testing.assert_allclose((mean > x).mean(), (x**-2 - 1) / 99, rtol=0.25)
