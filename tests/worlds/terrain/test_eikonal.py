"""Distances through free space."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.sparse import csgraph

from worlds.terrain.free_space import distance, links


def test_links_do_not_cut_corners() -> None:
    free = np.ones((2, 2), dtype=bool)
    assert links(free, np.ones((2, 2))).nnz == 6
    free[0, 0] = False
    graph = links(free, np.ones((2, 2))).toarray()
    assert graph[1, 2] == 0
    assert graph[1, 3] == graph[2, 3] == 1


def test_distance_is_never_above_dijkstra_and_satisfies_the_equation() -> None:
    rng = np.random.default_rng(0)
    free = rng.uniform(size=(40, 50)) > 0.2
    free[0, 0] = True
    cost = rng.uniform(1, 2, free.shape)
    graph = links(free, cost)
    field = distance(graph, cost, 0)
    eight = csgraph.dijkstra(graph, directed=False, indices=0).reshape(free.shape)
    np.testing.assert_array_equal(np.isfinite(field), np.isfinite(eight))
    reached = np.isfinite(field)
    assert np.all(field[reached] <= eight[reached] + 1e-9)
    T = np.pad(field, 1, constant_values=np.inf)
    lower = np.minimum.reduce([T[1:-1, :-2], T[1:-1, 2:], T[:-2, 1:-1], T[2:, 1:-1]])
    others = reached & (field > 0)
    # A neighbour is nearer to the start by the whole cost or, at 45°, by its part of it; never by more.
    fall = field[others] - lower[others]
    assert fall.min() > 0
    assert np.all(fall <= cost[others] + 1e-3)


@pytest.mark.parametrize("angle", np.deg2rad([0, 20, 45, 70]))
def test_distance_in_the_open_is_euclidean_in_every_direction(angle: float) -> None:
    cost = np.ones((121, 121))
    field = distance(links(np.ones_like(cost, dtype=bool), cost), cost, 60 * 121 + 60)
    j, i = np.rint(60 + 55 * np.array([np.cos(angle), np.sin(angle)])).astype(int)
    assert field[i, j] == pytest.approx(np.hypot(i - 60, j - 60), rel=0.03)


def test_what_is_cut_off_is_infinitely_far() -> None:
    free = np.ones((5, 5), dtype=bool)
    free[:, 2] = False
    field = distance(links(free, np.ones((5, 5))), np.ones((5, 5)), 0)
    assert np.isinf(field[:, 2:]).all()
    assert np.isfinite(field[:, :2]).all()
