"""Meshes are solid, convex where they collide, and covered with their picture without stretching it."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
import trimesh

from worlds.props.meshes import PERIOD, Ceiling, arch, boulder, hull, ledge, slab, stone_sizes, tilted, wedge
from worlds.props.shapes import Shape
from worlds.terrain.heightfield import Heightfield
from worlds.terrain.relief import swell

SEEDS = range(5)


def solid(shape: Shape) -> trimesh.Trimesh:
    """With equal vertices made one."""
    return trimesh.Trimesh(shape.vertices, shape.faces, process=True)


def pieces(seed: int) -> list[Shape]:
    rng = np.random.default_rng(seed)
    return [
        slab(rng, (2.0, 1.4, 0.2)),
        ledge(rng, (1.2, 1.8, 0.5)),
        wedge([(0, 0), (2, 0), (2, 1.4), (0, 1.1)], 0.5),
        *arch(1.6, 1.9, 0.3, 0.5),
        tilted(hull(rng.normal(size=(20, 3))), 0.4, -0.3),
    ]


@pytest.mark.parametrize("seed", SEEDS)
def test_pieces_are_closed_convex_and_turned_outwards(seed: int) -> None:
    for piece in pieces(seed):
        body = solid(piece)
        assert body.is_watertight
        assert body.volume > 0.01
        assert body.volume == pytest.approx(body.convex_hull.volume, rel=1e-5)


@pytest.mark.parametrize("seed", SEEDS)
def test_a_metre_of_a_piece_shows_no_more_than_a_metre_of_the_picture_and_not_much_less(seed: int) -> None:
    """A face is seen from the side that it looks to most: the picture is squeezed to no less than 1/√3 of its area."""
    for piece in pieces(seed)[:-1]:
        corners, texture = piece.vertices[piece.faces], piece.texcoord[piece.faces] * PERIOD
        shown = np.abs(np.cross(np.append(texture[:, 1] - texture[:, 0], np.zeros((len(texture), 1)), axis=1),
                                np.append(texture[:, 2] - texture[:, 0], np.zeros((len(texture), 1)), axis=1))[:, 2])  # fmt: skip
        area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
        assert np.all(shown <= area * (1 + 1e-9))
        assert np.all(shown >= area / np.sqrt(3) * (1 - 1e-9))


def test_a_slab_is_level_on_top_as_large_as_wanted_and_no_larger() -> None:
    stone = slab(np.random.default_rng(0), (2.0, 1.4, 0.2))
    low, high = stone.vertices.min(axis=0), stone.vertices.max(axis=0)
    assert high[2] == 0
    assert low[2] == pytest.approx(-0.2)
    assert np.all(high[:2] - low[:2] <= [2.0001, 1.4001])
    assert np.all(high[:2] - low[:2] > [1.7, 1.2])


def test_an_arch_leaves_its_opening_free_and_its_stones_touch() -> None:
    stones = arch(1.6, 1.9, 0.3, 0.5)
    vertices = np.concatenate([stone.vertices for stone in stones])
    radius = np.hypot(vertices[:, 0], vertices[:, 2] - 1.9)
    assert radius.min() == pytest.approx(0.8)
    assert radius.max() == pytest.approx(1.1)
    for one, other in pairwise(stones):
        shared = {tuple(v) for v in one.vertices.round(6)} & {tuple(v) for v in other.vertices.round(6)}
        assert len(shared) == 4


def test_points_in_a_plane_make_no_hull() -> None:
    with pytest.raises(ValueError, match="4 points lie in one plane, need a body"):
        hull([(0, 0, 1), (1, 0, 1), (0, 1, 1), (1, 1, 1)])


def test_the_tiles_of_a_ceiling_are_closed_and_leave_no_gaps_but_the_open_cells() -> None:
    rng = np.random.default_rng(0)
    field = Heightfield.flat([[0, 0], [6, 5]], 0.5)
    field = field.with_heights(3 + swell(rng, field.nodes, 2.0, 0.3))
    closed = np.ones((10, 12), dtype=bool)
    closed[4:6, 7] = False
    tiles = Ceiling(field, closed).tiles(5, 0.4)
    assert len(tiles) == 6
    assert sum(solid(tile).volume for tile in tiles) == pytest.approx((120 - 2) * 0.25 * 0.4)
    assert all(solid(tile).is_watertight for tile in tiles)
    under = np.concatenate([tile.vertices for tile in tiles])
    nodes = {tuple(v) for v in under.round(6)}
    expected = np.column_stack([field.nodes.reshape(-1, 2), field.heights.ravel()]).round(6)
    assert {tuple(v) for v in expected} <= nodes


@pytest.mark.parametrize("seed", range(5))
def test_a_boulder_collides_as_it_looks(seed: int) -> None:
    body = solid(boulder(np.random.default_rng(seed), (0.8, 0.6, 0.4)))
    assert body.is_watertight
    assert body.volume > 0
    np.testing.assert_allclose(body.volume, body.convex_hull.volume, rtol=1e-9)
    assert len(body.faces) <= 120


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
