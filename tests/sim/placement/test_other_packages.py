"""The environment beside the packages that people use with it: wrappers of gymnasium, stable-baselines3, and a training loop in CleanRL's manner."""

from __future__ import annotations

import warnings

import gymnasium
import numpy as np
import pytest
from gymnasium.wrappers import RecordEpisodeStatistics, RecordVideo, TimeLimit
from gymnasium.wrappers.vector import RecordEpisodeStatistics as VectorStatistics

from sim.placement.env import Placement

NAME = "pilsim/Placement-v0"
SMALL = {"world": "pilsun", "people": 6, "robots": 2, "map_seed": 0}


def test_statistics_and_time_limits_of_gymnasium():
    env = RecordEpisodeStatistics(TimeLimit(Placement(**SMALL), 5))
    env.reset(seed=0)
    rewards = []
    for _ in range(5):
        _, reward, _, truncated, info = env.step(env.action_space.sample())
        rewards.append(reward)
    assert truncated
    assert info["episode"]["l"] == 5
    assert info["episode"]["r"] == pytest.approx(sum(rewards))


def test_statistics_of_the_batched_environment():
    envs = VectorStatistics(gymnasium.make_vec(NAME, num_envs=2, max_episode_steps=4, **SMALL))
    envs.reset(seed=0)
    total = np.zeros(2)
    for _ in range(4):
        _, reward, _, truncated, info = envs.step(np.zeros((2, 2, 2), np.float32))
        total += reward
    assert truncated.all()
    np.testing.assert_allclose(info["episode"]["r"], total)
    envs.close()


@pytest.mark.command
def test_videos_of_gymnasium(tmp_path):
    pytest.importorskip("moviepy", reason="RecordVideo needs moviepy")
    env = RecordVideo(gymnasium.make(NAME, render_mode="rgb_array", max_episode_steps=3, **SMALL), str(tmp_path), disable_logger=True)
    env.reset(seed=0)
    for _ in range(3):
        env.step(env.action_space.sample())
    env.close()
    assert next(tmp_path.glob("*.mp4")).stat().st_size > 1000


@pytest.mark.soak
def test_stable_baselines_trains_on_it():
    ppo = pytest.importorskip("stable_baselines3", reason="needs stable-baselines3 (make rl)").PPO
    env = gymnasium.make(NAME, max_episode_steps=16, **SMALL)
    model = ppo("MultiInputPolicy", env, n_steps=32, batch_size=32, n_epochs=1, device="cpu", seed=0).learn(64)
    action, _ = model.predict(env.reset(seed=0)[0])
    assert env.action_space.contains(action)


def test_a_loop_in_the_manner_of_cleanrl():
    """REINFORCE with a linear Gaussian policy over a batch: observations, rewards and ends come as such loops expect them."""
    envs = gymnasium.make_vec(NAME, num_envs=4, max_episode_steps=6, **SMALL)
    rng, flat = np.random.default_rng(0), lambda observation: observation["robots"].reshape(4, -1)
    observation, _ = envs.reset(seed=0)
    weights = np.zeros((flat(observation).shape[1], 4))
    ended, episodes = np.zeros(4, dtype=bool), 0
    for _ in range(14):
        features = flat(observation)
        noise = rng.normal(size=(4, 4))
        action = (features @ weights + 0.5 * noise).reshape(4, 2, 2).clip(-1, 1).astype(np.float32)
        observation, reward, terminated, truncated, infos = envs.step(action)
        # The first step after an end begins the next episode, without a reward.
        assert (reward[ended] == 0.0).all()
        kept = ~ended
        weights += 0.01 * features[kept].T @ (noise[kept] * (reward[kept] - reward.mean())[:, None])
        ended = terminated | truncated
        episodes += int(ended.sum())
        assert reward.shape == (4,)
        assert infos["map_seed" if not kept.any() else "information"].shape == (4,)
    assert episodes == 8
    assert np.isfinite(weights).all()
    envs.close()


def test_gymnasium_warns_of_nothing():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        env = gymnasium.make(NAME, **SMALL)
        env.reset(seed=0)
        env.step(env.action_space.sample())
