"""The bound of people's positions: its parts against finite differences and random draws, and its order in simulated runs."""

import numpy as np
import pytest

from sim.scenario import Scenario
from sim.stress.bounds import HEAD, box_information, mean_distance, target_bound
from sim.stress.sweeps import Case
from sim.stress.trial_data import TrialData, simulate_case


def test_the_mean_distance_agrees_with_random_draws() -> None:
    rng = np.random.default_rng(0)
    covariances = np.array([np.diag([1.0, 1.0]), np.diag([4.0, 1e-12]), [[2.0, 0.7], [0.7, 0.5]]])
    for P, computed in zip(covariances, mean_distance(covariances), strict=True):
        drawn = np.linalg.norm(rng.multivariate_normal(np.zeros(2), P, 200_000), axis=1).mean()
        assert computed == pytest.approx(drawn, rel=5e-3)


def test_the_information_of_a_box_is_that_of_its_edges() -> None:
    """Against finite differences of the azimuth of the middle and of the elevations of feet and head."""
    eye, variance, step = np.array([3.0, -4.0, 1.5]), 1e-4, 1e-6

    def angles(feet: np.ndarray) -> np.ndarray:
        away = np.array([*feet, 0.0]) - eye
        r = np.hypot(away[0], away[1])
        return np.array([np.arctan2(away[1], away[0]), np.arctan2(away[2], r), np.arctan2(away[2] + HEAD, r)])

    J = np.stack([(angles(step * axis) - angles(-step * axis)) / (2 * step) for axis in np.eye(2)], axis=1)
    expected = J.T @ np.diag([2.0, 1.0, 1.0]) @ J / variance
    np.testing.assert_allclose(box_information(eye, variance), expected, rtol=1e-6)


def bound(noise: float, **changes: float) -> float:
    scenario = Scenario(seed=1006, robots=1, people=3, frames=8, width=256, bearing_noise=noise, **changes)
    data: TrialData = simulate_case(Case("box_noise/0", "box_noise", "bearing_noise", noise, scenario), rendered=False)
    found = target_bound(data)
    assert found is not None
    return found


def test_worse_boxes_and_fewer_of_them_raise_the_bound() -> None:
    """People and robots are the same in all three runs."""
    sharp, blunt, rare = bound(0.005), bound(0.02), bound(0.02, misses=0.7)
    assert sharp < blunt < rare
    # The motion model adds information, so that four times the noise is less than four times the bound.
    assert blunt < 4 * sharp
