"""What learning robots choose between, and what each of them is worth to its team."""

from __future__ import annotations

from dataclasses import replace

import gymnasium
import numpy as np
import pytest

import sim  # noqa: F401
from sim.placement.rewards import worth
from sim.policies.policy import Briefing
from sim.policies.waypoints import CHOICES, PARTS, STEPS, Watch, choices_of

OPTIONS = {"world": "pilsun", "people": 4, "robots": 3, "map_seed": 0}


def begun(seed: int = 0) -> tuple[gymnasium.Env, dict]:
    env = gymnasium.make("pilsim/Placement-v0", **OPTIONS, action="waypoint")
    return env, env.reset(seed=seed)[0]


def test_the_first_choice_is_to_stay_and_the_others_are_around():
    env, _ = begun()
    place = env.unwrapped.episode.place
    found, count = choices_of(place), len(place.roads.places)
    np.testing.assert_array_equal(found.goals[:, 0], np.arange(count))
    assert (found.way[:, 0] == 0.0).all()
    off = place.roads.places[found.goals] - place.roads.places[:, None]
    assert np.linalg.norm(off, axis=2).max() <= 2 * STEPS[-1] + 1e-9


def test_people_are_counted_once_by_who_else_sees_them():
    env, shown = begun()
    briefing = Briefing.of(env.unwrapped.episode, shown)
    place, watch = briefing.place, Watch(briefing)
    people = place.where_people_may_be[[3, 50, 90], :2]
    briefing = replace(briefing, position=people, velocity=np.zeros_like(people), covariance=np.tile(np.eye(2), (3, 1, 1)))
    known = watch.look(briefing)
    assert known.shape == (3, CHOICES, PARTS)
    sees = place.sees(briefing.config.reach)[:, [3, 50, 90]]
    np.testing.assert_allclose(known[..., :3].sum(axis=2), sees[watch.goals].sum(axis=2) / 4, atol=1e-6)
    assert (known[..., 3:6].sum(axis=2) <= 1 / 4 + 1e-6).all()
    np.testing.assert_array_equal(known[..., 8].sum(axis=1), 1.0)


def test_a_robot_is_worth_what_only_it_adds():
    pytest.importorskip("stable_baselines3", reason="needs stable-baselines3 (make rl)")
    from sim.policies.vector_env import own_worth

    env, _ = begun()
    episode = env.unwrapped.episode
    # Person 0 is seen by robots 0 and 1, person 1 by robot 0 alone, person 2 by all, person 3 by none.
    seen = np.array([[1.0, 1.0, 1.0, 0.0], [1.0, 0.0, 1.0, 0.0], [0.0, 0.0, 1.0, 0.0]])
    episode.now = replace(episode.now, seen=seen, stopped=np.array([0.0, 0.0, 1.0]))
    terms = {"seen": 0.75, "seen_twice": 0.5, "collisions": 1.0, "near_misses": 0.0, "energy": 0.6}
    reward = {"seen": 0.4, "seen_twice": 1.0, "collisions": -0.05, "energy": -1.0}
    np.testing.assert_allclose(own_worth(episode, reward, terms), [0.25 + 0.1 - 0.2, 0.25 - 0.2, -0.05 - 0.2])
    assert worth(reward, terms) == pytest.approx(0.3 + 0.5 - 0.05 - 0.6)


def test_robots_that_learn_are_environments_side_by_side():
    pytest.importorskip("stable_baselines3", reason="needs stable-baselines3 (make rl)")
    from sim.policies.vector_env import TeamVecEnv

    first, again = (TeamVecEnv(OPTIONS, 2) for _ in range(2))
    np.testing.assert_array_equal(first.reset(), again.reset())
    rng = np.random.default_rng(0)
    for k in range(41):
        choice = rng.integers(CHOICES, size=6)
        found, other = first.step(choice), again.step(choice)
        for a, b in zip(found[:3], other[:3], strict=True):
            np.testing.assert_array_equal(a, b)
        assert found[2].all() == (k == 39)
        assert all(info["TimeLimit.truncated"] == (k == 39) for info in found[3])
    assert len(first.finished) == 2
    first.close()
    again.close()
