import numpy as np
import pytest

from sim.pedestrian import foot_contact
from sim.pedestrian.foot_contact import HALF_SOLE, HEEL, PIVOT, sole_contact
from worlds.terrain.heightfield import Heightfield

SIZE = np.array([1.7])


def ground(heights) -> Heightfield:
    field = Heightfield.flat([[-2, -2], [2, 2]], 0.05)
    return field.with_heights(heights(field.nodes[..., 0], field.nodes[..., 1]))


def under(field: Heightfield, place: np.ndarray, yaw: float) -> tuple[np.ndarray, np.ndarray]:
    """Gaps (n,) m between the resting sole and the ground on a fine grid of the sole, and the result of `sole_contact`."""
    state = sole_contact(np.tile(place, (1, 2, 1)), np.full((1, 2), yaw), SIZE, field)[0, 0]
    along, aside = np.meshgrid(np.linspace(-HEEL, PIVOT, 25), np.linspace(-HALF_SOLE, HALF_SOLE, 5), indexing="ij")
    forward, left = np.array([np.cos(yaw), np.sin(yaw)]), np.array([-np.sin(yaw), np.cos(yaw)])
    points = place + SIZE[0] * (along[..., None] * forward + aside[..., None] * left)
    share = (along + HEEL) / (HEEL + PIVOT)
    sole = state[0] + share * (state[1] - state[0]) + np.tan(state[2]) * aside * SIZE[0]
    return (sole - field.height_at(points.reshape(-1, 2)).reshape(along.shape)).ravel(), state


@pytest.mark.parametrize("yaw", [0.0, 0.8, 2.5])
def test_on_a_slope_the_whole_sole_touches(yaw):
    gaps, state = under(ground(lambda x, y: 0.2 * x - 0.1 * y), np.array([0.3, -0.2]), yaw)
    assert np.abs(gaps).max() < 1e-9
    assert state[3] == -HEEL
    assert state[4] == PIVOT


@pytest.mark.parametrize("edge", [-0.05, 0.02, 0.06, 0.12])
def test_at_the_edge_of_a_step_the_sole_touches_without_penetration(edge):
    """The step is a ramp of 5 cm between nodes, so that the edge is sharp."""
    field = ground(lambda x, y: np.where(x < 0, 0.15, 0.0))
    gaps, _ = under(field, np.array([-edge, 0.0]), 0.0)
    assert gaps.min() > -0.015
    assert gaps.min() < 0.02


def test_on_rubble_soles_stay_within_two_centimetres_of_the_ground():
    rng = np.random.default_rng(0)
    field = ground(lambda x, y: 0.02 * rng.normal(size=x.shape))
    lowest = np.array([under(field, rng.uniform(-1.5, 1.5, 2), rng.uniform(-3, 3))[0].min() for _ in range(200)])
    assert np.quantile(lowest, 0.05) > -0.02, lowest
    assert lowest.max() < 0.02


def test_a_foot_rolls_over_its_support_until_it_touches_the_ground():
    _, state = under(ground(lambda x, y: 0.1 - 0.5 * np.abs(x)), np.array([-0.0275 * SIZE[0], 0.0]), 0.0)
    back, front, up, down = state[3:]
    assert back == front == pytest.approx(0.0275)
    # The ridge falls off by 0.5 on both sides: the sole can tip by that slope.
    assert up == pytest.approx(0.5, rel=0.1)
    assert down == pytest.approx(0.5, rel=0.1)


def test_rotations_are_about_the_rotated_axes():
    R = foot_contact.rotation_matrices(np.array(0.3), np.array(0.2), np.array(-0.1))
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(R) == pytest.approx(1.0)
    # Nose down, then the left side down.
    assert R[2, 0] < 0
    assert R[2, 1] < 0
