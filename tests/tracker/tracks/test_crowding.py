"""How crowded it is: distances of neighbours, what they do to merging and arrivals, and too few people to tell."""

from __future__ import annotations

import numpy as np
import pytest

from tracker.tracks.crowding import USUAL_DENSITY, Crowding


def test_few_people_change_nothing() -> None:
    crowding = Crowding(0.25)
    crowding.learn(np.array([[0.0, 0.0], [0.3, 0.0], [5.0, 1.0]]))
    assert (crowding.merge_distance(1.0), crowding.arrivals) == (1.0, 1.0)


@pytest.mark.parametrize(("spacing", "distance", "arrivals"), [(3.0, 1.0, 1.0), (0.5, 0.4, 1 / (4 * 0.25) / USUAL_DENSITY)])
def test_a_grid_of_people(spacing: float, distance: float, arrivals: float) -> None:
    """The nearest neighbour in a grid is one spacing away."""
    crowding = Crowding(0.25)
    grid = spacing * np.stack(np.meshgrid(np.arange(4), np.arange(3)), axis=-1).reshape(-1, 2)
    crowding.learn(grid)
    assert crowding.merge_distance(1.0) == pytest.approx(distance)
    assert crowding.arrivals == pytest.approx(arrivals)


def test_density_of_random_places_is_found() -> None:
    """Clark & Evans 1954: 2,000 people at random on 50 m x 50 m are 0.8 a square metre; the border makes them seem a little fewer."""
    crowding = Crowding(0.25)
    crowding.learn(np.random.default_rng(0).uniform(0.0, 50.0, (2000, 2)))
    assert crowding.arrivals == pytest.approx(0.8 / USUAL_DENSITY, rel=0.08)


def test_the_average_forgets() -> None:
    crowding = Crowding(1.5)
    near = np.array([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0], [3.0, 0.0]])
    crowding.learn(near)
    for _ in range(20):
        crowding.learn(4.0 * near)
    assert crowding.distance == pytest.approx(4.0, abs=1e-3)
