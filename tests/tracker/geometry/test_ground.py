"""Ground: heights, and intersections of rays compared with brute force."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.ndimage import gaussian_filter

from tracker.geometry import Array
from tracker.geometry.ground import Flat, Grid, Ground


def hills(seed: int, rough: float = 0.4, size: int = 50) -> Grid:
    rng = np.random.default_rng(seed)
    return Grid(gaussian_filter(rng.normal(0, rough, (size, size + 7)), 1.5) * 3, [-12.5, -14.0], 0.5)


def rays(rng: np.random.Generator, ground: Grid, n: int) -> tuple[Array, Array]:
    """Origins 0.2 to 2 m over the ground, a few outside the grid; directions from steeply down to a little up."""
    o = np.column_stack([rng.uniform(-15, 15, (n, 2)), np.zeros(n)])
    o[:, 2] = ground.height_at(o) + rng.uniform(0.2, 2, n)
    azimuth, elevation = rng.uniform(-np.pi, np.pi, n), rng.uniform(-0.8, 0.15, n)
    return o, np.column_stack([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])


# --- laws of every ground ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("ground", [Flat(), Flat(-1.5), hills(0), Grid([[0.0, 1], [2, 3]], [-20.0, -20], 40.0)])
def test_a_hit_lies_on_the_ground_on_the_ray_within_the_limit(ground: Ground) -> None:
    rng = np.random.default_rng(1)
    o, d = rays(rng, hills(0), 400)
    o[:, 2] += 3
    points, hit = ground.intersect(o, d, 30.0)
    assert hit.any()
    assert not hit.all()
    assert_allclose(points[hit, 2], ground.height_at(points[hit]), atol=1e-9)
    along = ((points - o) * d).sum(axis=1)[hit]
    assert_allclose(o[hit] + along[:, None] * d[hit], points[hit], atol=1e-9)
    assert ((along > 0) & (along <= 30 + 1e-9)).all()
    # What hits within 30 m hits within 60 m, at the same place.
    farther, still = ground.intersect(o, d, 60.0)
    assert still[hit].all()
    assert_allclose(farther[hit], points[hit], atol=1e-9)


@pytest.mark.parametrize("ground", [Flat(0.0), Grid(np.zeros((3, 3)), [-1.0, -1], 1.0)])
def test_ray_from_the_surface_leaves_upwards_and_hits_downwards(ground: Ground) -> None:
    o = np.array([[0.1, 0.2, 0.0], [0.1, 0.2, 1.0], [0.1, 0.2, 1.0], [0.1, 0.2, 1.0]])
    d = np.array([[0.6, 0, 0.8], [0, 0, -1.0], [0, 0, 1], [1, 0, 0]])
    points, hit = ground.intersect(o, d, 50.0)
    assert_array_equal(hit, [False, True, False, False])
    assert_allclose(points[1], [0.1, 0.2, 0], atol=1e-12)


# --- grids ------------------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", [0, 1])
def test_rays_against_brute_force(seed: int) -> None:
    rng, ground = np.random.default_rng(seed), hills(seed, rough=1.0)
    o, d = rays(rng, ground, 300)
    points, hit = ground.intersect(o, d, 25.0)
    along = np.linspace(0, 25, 10001)
    for k in range(len(o)):
        march = o[k] + along[:, None] * d[k]
        below = march[:, 2] <= ground.height_at(march)
        # A ray that only brushes the ground between two samples may be missed by this march, never the other way round.
        if hit[k]:
            found = np.linalg.norm(points[k] - o[k])
            assert not below[along < found - 1e-6].any()
            brushed = abs((o[k] + (found + 0.0025) * d[k])[2] - ground.height_at((o[k] + (found + 0.0025) * d[k])[None])[0]) < 1e-3
            assert brushed or below[(along >= found) & (along < found + 0.006)].any()
        else:
            assert not below.any()


@pytest.mark.parametrize(("seed", "size"), [(0, 50), (1, 50), (2, 3), (3, 9)])
def test_rays_that_skip_blocks_meet_the_ground_where_those_of_every_step_do(seed: int, size: int) -> None:
    rng, ground = np.random.default_rng(seed), hills(seed, rough=1.0, size=size)
    o, d = rays(rng, ground, 2000)
    d[:10], d[10:20], d[20:30] = [0, 0, -1], [1, 0, 0], [0, -1, 0]
    every = Grid(ground.heights, ground.origin, ground.spacing)
    # No ray is above this, so that none skips a block.
    every.__dict__["_peaks"] = np.full(ground._peaks.shape, 1e6)
    points, hit = ground.intersect(o, d, 25.0)
    expected, there = every.intersect(o, d, 25.0)
    assert hit.any()
    assert_array_equal(hit, there)
    assert_allclose(points, expected, atol=1e-9)


def test_a_ray_need_not_be_followed_beyond_what_matters() -> None:
    rng, ground = np.random.default_rng(5), hills(5, rough=1.0)
    o, d = rays(rng, ground, 1000)
    until = rng.uniform(0, 20, 1000)
    points, hit = ground.intersect(o, d, 25.0)
    nearer, found = ground.intersect(o, d, 25.0, until=until)
    near = hit & (np.linalg.norm(points - o, axis=1) < until - 1e-9)
    assert near.any()
    assert (hit & ~found).any()
    assert found[near].all()
    assert_array_equal(nearer[near], points[near])


def test_heights_are_those_of_the_planes_through_the_corners() -> None:
    ground, rng = hills(3), np.random.default_rng(3)
    slope = ground.height_at(rng.uniform(-11, 11, (50, 2)))
    assert np.isfinite(slope).all()
    plane = Grid(np.add.outer(np.arange(9) * 0.3, np.arange(7) * -0.2) + 1, [0.0, 0], 1.0)
    p = rng.uniform(0, 6, (100, 2))
    assert_allclose(plane.height_at(p), 1 - 0.2 * p[:, 0] + 0.3 * p[:, 1], atol=1e-12)


def test_a_grid_and_a_plane_agree_where_both_are_flat() -> None:
    rng = np.random.default_rng(4)
    o, d = rays(rng, hills(0), 300)
    o[:, 2] = rng.uniform(0.5, 3, 300)
    points, hit = Grid(np.zeros((4, 5)), [-3.0, -2], 1.0).intersect(o, d, 40.0)
    flat, known = Flat().intersect(o, d, 40.0)
    assert_array_equal(hit, known)
    assert_allclose(points[hit], flat[hit], atol=1e-9)


@pytest.mark.parametrize(
    ("heights", "spacing", "text"),
    [
        (np.zeros((1, 5)), 1.0, "at least 2 x 2"),
        (np.zeros((3, 3)), 0.0, "more than 0 m"),
        (np.zeros((3, 3)), np.nan, "more than 0 m"),
        (np.full((3, 3), np.nan), 1.0, "heights holds NaN"),
        (np.zeros(3), 1.0, "heights has shape"),
    ],
)
def test_grids_are_checked(heights: Array, spacing: float, text: str) -> None:
    with pytest.raises(ValueError, match=text):
        Grid(heights, [0.0, 0], spacing)
