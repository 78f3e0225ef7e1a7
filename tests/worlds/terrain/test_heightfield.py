"""The terrain in numbers is the terrain that MuJoCo has."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from worlds.terrain.heightfield import Heightfield


def random_field(rng: np.random.Generator) -> Heightfield:
    shape = rng.integers(2, 30, 2)
    return Heightfield(rng.uniform(-1, 1) + rng.uniform(0.01, 2) * rng.normal(size=shape), rng.uniform(-5, 5, 2), rng.uniform(0.05, 1.5))


def rays_down(spec: mujoco.MjSpec, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What MuJoCo's own rays find of geoms in group 0 under points (n, 2): heights (n,), normals (n, 3)."""
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    group, geom, normal = np.array([1, 0, 0, 0, 0, 0], dtype=np.uint8), np.zeros(1, dtype=np.int32), np.zeros(3)
    heights, normals = np.empty(len(points)), np.empty((len(points), 3))
    for k, (x, y) in enumerate(points):
        d = mujoco.mj_ray(model, data, np.array([x, y, 20.0]), np.array([0, 0, -1.0]), group, 1, -1, geom, normal)
        heights[k], normals[k] = 20.0 - d, normal
    return heights, normals


def check_against_rays(field: Heightfield, spec: mujoco.MjSpec, points: np.ndarray) -> None:
    heights, normals = rays_down(spec, points)
    np.testing.assert_allclose(field.height_at(points), heights, atol=1e-6)
    np.testing.assert_allclose(field.normal_at(points), normals, atol=1e-4)


@pytest.mark.parametrize("seed", range(6))
def test_rays_meet_the_field_where_it_says(seed: int) -> None:
    rng = np.random.default_rng(seed)
    field = random_field(rng)
    spec = mujoco.MjSpec()
    geom = field.add_to(spec, "ground")
    assert geom.name == "ground"
    assert geom.group == 0
    check_against_rays(field, spec, rng.uniform(*field.extent, (1000, 2)))


@pytest.mark.parametrize("level", [-3.0, 0.0, 0.7])
def test_flat_ground_is_at_its_level(level: float) -> None:
    field = Heightfield.flat([[-2, -1], [3, 1]], 0.5).with_heights(level)
    spec = mujoco.MjSpec()
    field.add_to(spec, "ground")
    check_against_rays(field, spec, np.random.default_rng(0).uniform(*field.extent, (200, 2)))


def test_grid_points_have_their_own_heights_and_outside_the_nearest() -> None:
    field = random_field(np.random.default_rng(1))
    np.testing.assert_allclose(field.height_at(field.nodes.reshape(-1, 2)), field.heights.ravel(), atol=1e-12)
    corner, opposite = field.extent
    np.testing.assert_allclose(field.height_at([corner - 3.0, opposite + np.array([1, 9])]), [field.heights[0, 0], field.heights[-1, -1]], atol=1e-12)


def test_slope_is_that_of_a_plane_and_the_steepest_around() -> None:
    field = Heightfield.flat([[0, 0], [2, 3]], 0.25)
    plane = field.with_heights(0.3 * field.nodes[..., 0] - 0.4 * field.nodes[..., 1])
    np.testing.assert_allclose(plane.slope, np.arctan(0.5), atol=1e-12)
    rough = random_field(np.random.default_rng(3))
    points = np.random.default_rng(4).uniform(*rough.extent, (3000, 2))
    steepest = np.arccos(rough.normal_at(points)[:, 2]).max()
    assert rough.slope.max() >= steepest - 1e-9


def test_flat_covers_its_extent_with_whole_cells() -> None:
    field = Heightfield.flat([[-1, 2], [0.95, 2.4]], 0.2)
    assert field.heights.shape == (3, 11)
    np.testing.assert_allclose(field.extent, [[-1, 2], [1, 2.4]])


def test_a_field_cannot_be_changed_nor_made_of_nonsense() -> None:
    field = Heightfield.flat([[0, 0], [1, 1]], 0.5)
    with pytest.raises(ValueError, match="read-only"):
        field.heights[0, 0] = 1.0
    for heights, origin, spacing, words in (
        (np.zeros((1, 5)), np.zeros(2), 1.0, "at least"),
        (np.zeros((3, 3)), np.zeros(3), 1.0, "origin"),
        (np.full((3, 3), np.nan), np.zeros(2), 1.0, "finite"),
        (np.zeros((3, 3)), np.zeros(2), 0.0, "spacing"),
    ):
        with pytest.raises(ValueError, match=words):
            Heightfield(heights, origin, spacing)
