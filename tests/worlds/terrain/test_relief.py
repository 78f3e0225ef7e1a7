"""Pieces of terrain, and the noise that they are made of."""

from __future__ import annotations

import numpy as np
import pytest

from worlds.terrain.heightfield import Heightfield
from worlds.terrain.polygons import rectangle, signed_distance
from worlds.terrain.relief import noise, plateau, ramp, rubble, swell

GROUND = Heightfield.flat([[-4, -3], [4, 3]], 0.1)
NODES = GROUND.nodes


@pytest.mark.parametrize("period", [1.5, 7.3, 40.0, (3.0, 25.0)])
def test_noise_is_bounded_smooth_and_the_same_again(period: float | tuple[float, float]) -> None:
    pattern = noise(np.random.default_rng(0), (64, 90), period)
    assert pattern.shape == (64, 90)
    assert np.abs(pattern).max() <= 1
    assert pattern.std() > 0.1
    np.testing.assert_array_equal(pattern, noise(np.random.default_rng(0), (64, 90), period))
    # The blend's steepest is 15/8 of a straight line's, and values differ by 2 at most.
    rows, columns = period if isinstance(period, tuple) else (period, period)
    assert np.abs(np.diff(pattern, axis=0)).max() <= 2 * 1.875 / rows + 1e-5
    assert np.abs(np.diff(pattern, axis=1)).max() <= 2 * 1.875 / columns + 1e-5


def test_swell_stays_within_its_height() -> None:
    z = swell(np.random.default_rng(0), NODES, 1.5, 0.05)
    assert z.shape == NODES.shape[:2]
    assert 0.02 < np.abs(z).max() <= 0.05


def test_a_plateau_is_level_and_its_edge_one_cell_wide() -> None:
    corners = rectangle((0.33, 0.2), (3.0, 2.0), 0.4)
    z = plateau(NODES, corners, 0.3)
    inside = signed_distance(NODES, corners)
    np.testing.assert_array_equal(z, np.where(inside <= 0, 0.3, 0.0))
    field = GROUND.with_heights(z)
    p = np.random.default_rng(0).uniform(*GROUND.extent, (5000, 2))
    d = signed_distance(p, corners)
    np.testing.assert_allclose(field.height_at(p[d < -0.15]), 0.3)
    np.testing.assert_allclose(field.height_at(p[d > 0.15]), 0.0)


def test_a_ramp_has_its_slope_along_and_none_across() -> None:
    foot, top = np.array([-2.0, -1.0]), np.array([1.0, 1.0])
    ahead = (top - foot) / np.hypot(*(top - foot))
    across = np.array([-ahead[1], ahead[0]])
    field = GROUND.with_heights(ramp(NODES, foot, top, 1.6, 0.4))
    along, beside = np.meshgrid([0.3, 1.0, 3.0], [-0.6, 0.0, 0.6])
    p = foot + along.reshape(-1, 1) * ahead + beside.reshape(-1, 1) * across
    np.testing.assert_allclose(field.height_at(p), 0.4 * along.ravel() / np.hypot(*(top - foot)))
    np.testing.assert_allclose(field.height_at([foot - 0.3 * ahead, top + 0.3 * ahead, foot + ahead + 1.1 * across]), 0)


def test_rubble_stays_in_its_place() -> None:
    z = rubble(np.random.default_rng(0), NODES, (0.5, 0.5), 1.2, 0.06)
    assert z.min() >= 0
    assert 0.02 < z.max() <= 0.06
    assert not z[np.hypot(*np.moveaxis(NODES - 0.5, -1, 0)) > 1.2].any()
