"""The walkable prior on maps made by hand, against samples, and for a hidden person who walks up to a wall."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tracker.datasets import synthetic_crowd
from tracker.detections.walkable_prior import FLOOR, WalkablePrior
from tracker.geometry import Array
from tracker.geometry.ground import Flat, Grid
from tracker.pipeline import Parameters, Tracker


def grid(heights: Array) -> Grid:
    """(81, 81) from (-10, -10) m on, 0.25 m apart."""
    return Grid(heights, np.array([-10.0, -10.0]), 0.25)


def walled() -> tuple[Grid, Grid]:
    """Level ground with a wall along y, from x = 2 to 3 m."""
    tops = np.zeros((81, 81))
    tops[:, 48:53] = 2.0
    return grid(np.zeros((81, 81))), grid(tops)


def prior_of(ground: Grid, tops: Grid) -> WalkablePrior:
    found = WalkablePrior.of(ground, tops)
    assert found is not None
    return found


def test_the_prior_is_low_in_a_wall_and_beyond_the_grid_alone() -> None:
    likely = prior_of(*walled()).at(np.array([[2.5, 0.0], [0.0, 11.0], [0.0, 0.0], [4.0, 0.0]]))
    np.testing.assert_allclose(likely, [FLOOR, FLOOR, 1.0, 1.0], atol=1e-3)


@pytest.mark.parametrize(("slope", "free"), [(0.0, True), (0.3, True), (0.8, False)])
def test_the_prior_is_low_on_a_steep_bank(slope: float, free: bool) -> None:
    x = np.linspace(-10, 10, 81)
    bank = grid(np.tile(slope * np.maximum(x - 4.0, 0.0), (81, 1)))
    likely = prior_of(bank, bank).at(np.array([[0.0, 0.0], [6.0, 0.0]]))
    assert likely[0] > 0.99
    assert (likely[1] > 0.95) == free
    assert free or likely[1] < 2 * FLOOR


def test_the_prior_is_high_above_and_below_a_step() -> None:
    heights = np.zeros((81, 81))
    heights[:, 40:] = -1.0
    step = grid(heights)
    assert prior_of(step, step).at(np.array([[-0.5, 0.0], [0.5, 0.0]])).min() > 0.9


def test_an_unknown_world_has_no_prior() -> None:
    assert WalkablePrior.of(Flat(), None) is None
    assert WalkablePrior.of(Flat(), Flat()) is None


def test_posteriors_beside_a_wall_match_samples() -> None:
    known, rng = prior_of(*walled()), np.random.default_rng(0)
    mean, P = np.array([1.6, 0.0]), np.array([[0.5, 0.2], [0.2, 0.4]])
    place = rng.multivariate_normal(mean, P, 200_000)
    weight = known.at(place)
    expected = weight @ place / weight.sum()
    apart = place - expected
    found, spread, likely = known.posterior(mean[None], P[None])
    assert likely[0] == pytest.approx(weight.mean(), abs=0.06)
    np.testing.assert_allclose(found[0], expected, atol=0.08)
    np.testing.assert_allclose(spread[0], (weight[:, None] * apart).T @ apart / weight.sum(), atol=0.05)
    assert found[0, 0] < mean[0] - 0.2


@pytest.mark.parametrize("known", [False, True])
def test_a_hidden_person_who_walks_towards_a_wall_stops_before_it(known: bool) -> None:
    ground, tops = walled()
    heights = tops.heights.copy()
    heights[36:38, 38:48] = 2.0  # between the view and the last steps before the wall
    tops = grid(heights)
    setup = synthetic_crowd.setup(1)
    setup = replace(setup, ground=ground, occluders=tops if known else None)
    x = np.minimum(-5.0 + 2.0 / synthetic_crowd.RATE * np.arange(40), 1.5)
    path = np.stack([x, np.zeros(40)], axis=1)[:, None, :]
    ticks = synthetic_crowd.ticks(setup, path, np.random.default_rng(0), misses=0.0, clutter=0.0, lose=lambda frame, camera, person: x[frame] > 0.8)
    tracker, farthest = Tracker(setup, Parameters()), -np.inf
    for tick in ticks:
        estimate = tracker.step(tick)
        assert estimate is not None
        farthest = max(farthest, float(estimate.position[:, 0].max(initial=-np.inf)))
    assert farthest > 1.0
    assert (farthest < 2.0) == known
