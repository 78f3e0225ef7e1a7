"""The PettingZoo environment: its contract, and its agreement with the gymnasium environment."""

from __future__ import annotations

import numpy as np
import pytest
from pettingzoo.test import parallel_api_test, parallel_seed_test

from sim.placement.env import Placement
from sim.placement.parallel_env import parallel_env

SMALL = {"world": "pilsun", "people": 6, "robots": 3}


def test_pettingzoo_checkers_pass():
    parallel_api_test(parallel_env(max_cycles=30, **SMALL), num_cycles=40)
    parallel_seed_test(lambda: parallel_env(max_cycles=30, **SMALL), num_cycles=10)


def test_it_agrees_with_the_gymnasium_environment():
    many, one = parallel_env(**SMALL), Placement(**SMALL)
    observation, _ = many.reset(seed=4)
    whole, _ = one.reset(seed=4)
    action = np.random.default_rng(0).uniform(-1, 1, (3, 2)).astype(np.float32)
    observation, rewards, _, _, infos = many.step({f"robot_{k}": action[k] for k in range(3)})
    whole, reward, _, _, info = one.step(action)
    assert set(rewards.values()) == {reward}
    assert infos["robot_1"] == info
    np.testing.assert_array_equal(observation["robot_2"]["map"], whole["map"][2])
    np.testing.assert_array_equal(observation["robot_2"]["beliefs"], whole["beliefs"])
    assert many.state_space.contains(many.state())


def test_missing_actions_are_refused():
    env = parallel_env(**SMALL)
    env.reset(seed=0)
    with pytest.raises(ValueError, match="robot_2"):
        env.step({"robot_0": np.zeros(2), "robot_1": np.zeros(2)})
    with pytest.raises(ValueError, match="max_cycles is 0"):
        parallel_env(max_cycles=0)
