"""Waypoint choices, their features, difference rewards, and the expected density of unseen people."""

from __future__ import annotations

from dataclasses import replace

import gymnasium
import numpy as np
import pytest

from sim.placement.config import PlacementConfig
from sim.placement.episode import reward_of
from sim.placement.map import MapKey, map_of
from sim.policies.policy import TeamKnowledge
from sim.policies.waypoints import CHOICES, DISTANCES, POINT_FEATURES, UnseenMap, WaypointFeatures, choices_of

OPTIONS = {"world": "pilsun", "people": 4, "robots": 3, "map_seed": 0}


def begun(seed: int = 0) -> tuple[gymnasium.Env, dict]:
    env = gymnasium.make("pilsim/Placement-v0", **OPTIONS, action="waypoint")
    return env, env.reset(seed=seed)[0]


def test_the_first_choice_is_to_stay_and_the_others_are_nearby():
    env, _ = begun()
    place = env.unwrapped.episode.place
    (goals, path_length), count = choices_of(place), len(place.roadmap.nodes)
    np.testing.assert_array_equal(goals[:, 0], np.arange(count))
    assert (path_length[:, 0] == 0.0).all()
    off = place.roadmap.nodes[goals] - place.roadmap.nodes[:, None]
    assert np.linalg.norm(off, axis=2).max() <= 2 * DISTANCES[-1] + 1e-9


def test_people_are_divided_by_the_number_of_other_views():
    env, observation = begun()
    knowledge = TeamKnowledge.of(env.unwrapped.episode, observation)
    place, features = knowledge.place, WaypointFeatures(knowledge)
    people = place.walkable_points[[3, 50, 90], :2]
    knowledge = replace(knowledge, position=people, velocity=np.zeros_like(people), covariance=np.tile(np.eye(2), (3, 1, 1)))
    known = features.update(knowledge)
    assert known.shape == (3, CHOICES, POINT_FEATURES)
    visible = place.visible_from_nodes(knowledge.config.reach)[:, [3, 50, 90]]
    np.testing.assert_allclose(known[..., :3].sum(axis=2), visible[features.goals].sum(axis=2) / 4, atol=1e-6)
    assert (known[..., 3:6].sum(axis=2) <= 1 / 4 + 1e-6).all()
    np.testing.assert_array_equal(known[..., 8].sum(axis=1), 1.0)


def test_difference_rewards_are_what_only_one_robot_adds():
    pytest.importorskip("stable_baselines3", reason="needs stable-baselines3 (make rl)")
    from sim.policies.vector_env import difference_rewards

    env, _ = begun()
    episode = env.unwrapped.episode
    # Person 0 is seen by robots 0 and 1, person 1 by robot 0 alone, person 2 by all, person 3 by none.
    seen = np.array([[1.0, 1.0, 1.0, 0.0], [1.0, 0.0, 1.0, 0.0], [0.0, 0.0, 1.0, 0.0]])
    episode.now.seen[:], episode.now.stopped[:] = seen, [0, 0, 1]
    episode.states.added[episode.row] = [0.6, 0.2, 0.0]
    terms = {"information": 3.0, "seen": 0.75, "seen_twice": 0.5, "collisions": 1.0, "near_misses": 0.0, "energy": 0.6}
    reward = {"seen": 0.4, "seen_twice": 1.0, "collisions": -0.05, "energy": -1.0}
    np.testing.assert_allclose(difference_rewards(episode, reward, terms), [0.25 + 0.1 - 0.2, 0.25 - 0.2, -0.05 - 0.2])
    assert reward_of(reward, terms) == pytest.approx(0.3 + 0.5 - 0.05 - 0.6)
    np.testing.assert_allclose(difference_rewards(episode, {"information": 0.5}, terms), [0.3, 0.1, 0.0])


def test_the_vector_environment_is_deterministic_and_truncates():
    pytest.importorskip("stable_baselines3", reason="needs stable-baselines3 (make rl)")
    from sim.policies.vector_env import TeamVecEnv, row_length

    first, again = (TeamVecEnv([OPTIONS, OPTIONS | {"people": 2, "robots": 2}]) for _ in range(2))
    begun = first.reset()
    np.testing.assert_array_equal(begun, again.reset())
    # Teams with fewer people have rows of zeros for the others.
    assert (begun[3:, row_length(2) :] == 0).all()
    assert begun.shape == (5, row_length(4))
    rng = np.random.default_rng(0)
    for k in range(121):
        choice = rng.integers(CHOICES, size=5)
        found, other = first.step(choice), again.step(choice)
        for a, b in zip(found[:3], other[:3], strict=True):
            np.testing.assert_array_equal(a, b)
        assert found[2].all() == (k == 119)
        assert all(info["TimeLimit.truncated"] == (k == 119) for info in found[3])
    assert len(first.finished) == 2
    first.close()
    again.close()


def test_observed_points_are_empty_and_recover():
    place = map_of(MapKey("pilsun", 0.5, 0, 6))
    config, none = PlacementConfig(world="pilsun", robots=1, people=6), np.zeros((0, 2))

    def at(number: int) -> TeamKnowledge:
        robot = np.array([[*place.roadmap.nodes[number], 0.0]])
        return TeamKnowledge(place, config, robot, none, none, np.zeros((0, 2, 2)), {})

    unseen, visible = UnseenMap(place), place.visible_from_nodes(config.reach)
    far = int(np.argmax(place.roadmap.distance[0]))
    assert unseen.update(at(0), 0.25).tolist() == [0]
    np.testing.assert_array_equal(unseen.density, np.where(visible[0], 0.0, place.traffic))
    unseen.update(at(far), 0.25)
    np.testing.assert_allclose(unseen.density, np.where(visible[far], 0.0, np.where(visible[0], 0.25, 1.0) * place.traffic))
    assert (visible[0] & ~visible[far]).any()
    # The map itself is unchanged.
    np.testing.assert_array_equal(UnseenMap(place).density, place.traffic)
