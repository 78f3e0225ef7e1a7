"""Polygons in the plane."""

from __future__ import annotations

import numpy as np
import pytest

from worlds.terrain.heightfield import Heightfield
from worlds.terrain.polygons import covered, offset, rectangle, signed_distance, turned

L_SHAPE = np.array([[0, 0], [4, 0], [4, 1], [1, 1], [1, 3], [0, 3]], dtype=float)


def area(corners: np.ndarray) -> float:
    x, y = corners.T
    return float(0.5 * (x * np.roll(y, -1) - y * np.roll(x, -1)).sum())


def test_signed_distance_against_hand_made_places() -> None:
    points = [[0.5, 0.5], [2, 0.5], [2, 2], [-3, -4], [0.5, 3.25], [5, 0.5]]
    np.testing.assert_allclose(signed_distance(points, L_SHAPE), [-0.5, -0.5, 1.0, 5.0, 0.25, 1.0])


@pytest.mark.parametrize("yaw", [0.0, 0.3, 2.0, -3.0])
def test_a_turned_rectangle_keeps_area_order_and_distances(yaw: float) -> None:
    corners = rectangle((1.0, -2.0), (3.0, 0.5), yaw)
    assert area(corners) == pytest.approx(1.5)
    ahead = turned([1.0, 0.0], yaw)
    np.testing.assert_allclose(ahead, [np.cos(yaw), np.sin(yaw)], atol=1e-12)
    centre = np.array([1.0, -2.0])
    np.testing.assert_allclose(signed_distance([centre, centre + 2.5 * ahead], corners), [-0.25, 1.0], atol=1e-12)


def test_offset_moves_every_edge_by_the_distance() -> None:
    corners = turned(L_SHAPE, 0.7)
    wider = offset(corners, 0.2)
    edge = np.roll(wider, -1, axis=0) - wider
    outward = np.stack([edge[:, 1], -edge[:, 0]], axis=1) / np.hypot(*edge.T)[:, None]
    np.testing.assert_allclose(((wider - corners) * outward).sum(axis=1), 0.2)
    assert area(wider) > area(corners)
    np.testing.assert_allclose(offset(wider, -0.2), corners, atol=1e-12)


def test_covered_is_the_distance_over_the_whole_grid() -> None:
    ground = Heightfield.flat([[-1, -1], [5, 4]], 0.13)
    rng = np.random.default_rng(0)
    for _ in range(50):
        corners, margin = rectangle(rng.uniform(-3, 6, 2), rng.uniform(0.1, 3, 2), rng.uniform(-4, 4)), rng.uniform(0, 0.5)
        np.testing.assert_array_equal(covered(ground, corners, margin), signed_distance(ground.nodes, corners) <= margin)
