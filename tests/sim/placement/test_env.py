"""The gymnasium environment: its contract, reproducibility, reward terms and errors."""

from __future__ import annotations

import copy
import gc
import pickle
import tracemalloc

import gymnasium
import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from gymnasium.utils.env_checker import check_env

from sim.placement.episode import WEIGHTS
from sim.placement.information import TERMS
from worlds import catalogue

NAME = "pilsim/Placement-v0"


def make(**options: object) -> gymnasium.Env:
    return gymnasium.make(NAME, **({"world": "pilsun", "people": 6, "robots": 3} | options))


def assert_same(a: dict, b: dict) -> None:
    assert a.keys() == b.keys()
    for name in a:
        np.testing.assert_array_equal(a[name], b[name])


@pytest.mark.filterwarnings("ignore")
def test_gymnasium_checker_passes():
    check_env(make(render_mode="rgb_array", map_seed=0).unwrapped)


@pytest.mark.soak
@pytest.mark.filterwarnings("ignore")
def test_stable_baselines_checker_passes():
    checker = pytest.importorskip("stable_baselines3.common.env_checker", reason="needs stable-baselines3 (make rl)")
    checker.check_env(make())


@pytest.mark.soak
@pytest.mark.parametrize("options", [{"action": "waypoint"}, {"drive": "physics"}, {"observation": "tracks"}], ids=str)
def test_equal_seeds_and_copies_give_equal_episodes(options):
    env, other = make(**options), make(**options)
    actions = np.random.default_rng(0).uniform(-1, 1, (4, 3, 2)).astype(np.float32)
    assert_same(env.reset(seed=5)[0], other.reset(seed=5)[0])
    for action in actions[:3]:
        a, b = env.step(action), other.step(action)
        assert_same(a[0], b[0])
        assert a[1] == b[1]
        assert a[4] == b[4]
    copies = [env, copy.deepcopy(env), pickle.loads(pickle.dumps(env))]
    first, *others = [one.step(actions[3]) for one in copies]
    for step in others:
        assert_same(first[0], step[0])
        assert first[1] == step[1]


def test_seeds_differ_and_ten_consecutive_ones_share_a_map():
    env = make()
    one, first = env.reset(seed=3)
    two, second = env.reset(seed=4)
    assert first["map_seed"] == second["map_seed"] == 0
    assert not np.array_equal(one["robots"], two["robots"])
    assert make(map_seed=7).reset(seed=3)[1]["map_seed"] == 7


def test_info_has_all_terms_and_the_reward_is_their_weighted_sum():
    env = make()
    env.reset(seed=1)
    for _ in range(5):
        _, reward, _, _, info = env.step(env.action_space.sample())
        assert set(info) == set(TERMS)
        assert reward == pytest.approx(sum(weight * info[name] for name, weight in WEIGHTS.items()))
        assert 0 <= info["seen_twice"] <= info["seen"] <= 1
    mine = make(reward=lambda terms: 10 * terms["seen"])
    mine.reset(seed=1)
    _, reward, _, _, info = mine.step(np.zeros((3, 2), np.float32))
    assert reward == 10 * info["seen"]


def test_given_starts_and_velocity_commands_are_followed():
    env = make(people=0, robots=1)
    env.reset(seed=0)
    episode = env.unwrapped.episode
    place = episode.place.roadmap.nodes[int(np.argmax(episode.place.free_space.clearance_at(episode.place.roadmap.nodes)))]
    env.reset(seed=0, options={"starts": [[*place, 0.5]]})
    np.testing.assert_allclose(env.unwrapped.episode.now.team[0, :3], [*place, 0.5])
    env.step(np.array([[0.0, 1.0]], np.float32))
    # The yaw rate grows at 1.6 rad/s² to 0.8 rad/s within the half second: the turn is about half of 0.8 · 0.5 rad.
    assert 0.15 < env.unwrapped.episode.now.team[0, 2] - 0.5 < 0.25
    np.testing.assert_allclose(env.unwrapped.episode.now.team[0, :2], place, atol=1e-9)


@pytest.mark.parametrize("world", ["pilsun", "campus"])
def test_waypoints_are_reached(world):
    """Nodes of campus are farther apart than robots look ahead."""
    env = make(world=world, people=0, robots=2, action="waypoint")
    env.reset(seed=2)
    place = env.unwrapped.episode.place
    far = np.argsort(place.roadmap.distance[place.roadmap.nearest(env.unwrapped.episode.now.team[:1, :2])[0]])
    goals = place.roadmap.nodes[[far[len(far) // 2], far[-1]]]
    action = place.normalised(goals).astype(np.float32)
    for _ in range(160):
        env.step(action)
    left = np.linalg.norm(env.unwrapped.episode.now.team[:, :2] - goals, axis=1)
    assert left.max() < 0.5


def test_episodes_are_truncated_by_time_and_terminate_when_all_robots_tip():
    env = make()
    env.reset(seed=0)
    ends = [env.step(env.action_space.sample())[2:4] for _ in range(240)]
    assert ends[:-1] == [(False, False)] * 239
    assert ends[-1] == (False, True)
    env.reset(seed=0)
    mover = env.unwrapped.episode.mover
    type(mover).tipped, kept = lambda self: np.ones(len(self.team), dtype=bool), type(mover).tipped
    try:
        _, reward, terminated, _, info = env.step(env.action_space.sample())
    finally:
        type(mover).tipped = kept
    assert terminated
    assert info["tip_overs"] == 3
    assert info["seen"] == 0
    assert reward < -10
    with pytest.raises(ResetNeeded):
        env.unwrapped.step(env.action_space.sample())
    # Wrappers that record videos draw the end of an episode.
    env.unwrapped.render_mode = "rgb_array"
    assert env.unwrapped.render().ndim == 3
    env.reset(seed=1)
    env.step(env.action_space.sample())


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"world": "moon"}, "world is 'moon'"),
        ({"robots": 0}, r"robots is 0, .*\[1, 16\]"),
        ({"people": 2.5}, "people is 2.5"),
        ({"difficulty": float("nan")}, "difficulty is nan"),
        ({"drive": "fly"}, "drive is 'fly'"),
        ({"colour": 1}, "no options colour"),
        ({"density": "s9"}, "density is 's9'"),
        ({"reward": {"fun": 1.0}}, "term 'fun'"),
        ({"reward": {"seen": float("inf")}}, "weight of seen"),
        ({"width": 71}, "width is 71"),
    ],
)
def test_invalid_options_are_refused(options, message):
    with pytest.raises(ValueError, match=message):
        make(**options)


def test_invalid_actions_and_starts_are_refused():
    env = make()
    with pytest.raises(ResetNeeded):
        env.unwrapped.step(np.zeros((3, 2)))
    env.reset(seed=0)
    with pytest.raises(ValueError, match=r"shape \(2, 2\), needs \(3, 2\)"):
        env.unwrapped.step(np.zeros((2, 2)))
    with pytest.raises(ValueError, match="finite"):
        env.unwrapped.step(np.full((3, 2), np.nan))
    with pytest.raises(ValueError, match="knows starts"):
        env.unwrapped.reset(options={"start": 1})
    with pytest.raises(ValueError, match="not free"):
        env.unwrapped.reset(options={"starts": [[1e3, 0, 0], [0, 0, 0], [0, 0, 0]]})
    with pytest.raises(ValueError, match=r"need \(3, 3\)"):
        env.unwrapped.reset(options={"starts": [[0, 0]]})
    with pytest.raises(ValueError, match="people is 200, more than pilsun holds"):
        make(people=200).reset(seed=0)


@pytest.mark.command
def test_all_vector_modes_play_the_same_episodes():
    found: dict[str, list] = {}
    for mode in ("vector_entry_point", "sync", "async"):
        options = {"max_episode_steps": 3, "world": "pilsun", "people": 6, "robots": 3, "reward": {"information": 1.0, "gospa": -0.1}}
        envs = gymnasium.make_vec(NAME, num_envs=2, vectorization_mode=mode, **options)
        actions = np.random.default_rng(0).uniform(-1, 1, (6, 2, 3, 2)).astype(np.float32)
        # Six decisions: episodes end after three, and others begin in the fourth.
        found[mode] = [envs.reset(seed=9), *(envs.step(action) for action in actions)]
        envs.close()
    for one, sync, other in zip(*found.values(), strict=True):
        for a, b in ((one, sync), (sync, other)):
            assert_same(a[0], b[0])
            assert_same(a[-1], b[-1])
            for x, y in zip(a[1:-1], b[1:-1], strict=True):
                np.testing.assert_array_equal(x, y)
    assert [step[3].all() for step in found["sync"][1:]] == [False, False, True, False, False, False]


def test_threads_change_nothing_and_wrong_actions_are_refused():
    one, two = (gymnasium.make_vec(NAME, num_envs=3, threads=threads, world="pilsun", people=6, robots=3) for threads in (1, 2))
    assert_same(one.reset(seed=4)[0], two.reset(seed=4)[0])
    for _ in range(3):
        a, b = one.step(np.full((3, 3, 2), 0.4, np.float32)), two.step(np.full((3, 3, 2), 0.4, np.float32))
        assert_same(a[0], b[0])
        np.testing.assert_array_equal(a[1], b[1])
    with pytest.raises(ValueError, match=r"shape \(2, 3, 2\), needs \(3, 3, 2\)"):
        one.step(np.zeros((2, 3, 2)))
    with pytest.raises(ValueError, match="num_envs is 0"):
        gymnasium.make_vec(NAME, num_envs=0)
    one.close()
    two.close()


def test_render_draws_the_plan():
    env = make(render_mode="rgb_array")
    env.reset(seed=0)
    before = env.render()
    env.step(np.ones((3, 2), np.float32))
    after = env.render()
    assert before.shape == after.shape
    assert before.dtype == np.uint8
    assert np.abs(before.astype(int) - after).max() > 10


@pytest.mark.render
def test_pixel_observations_are_panoramas():
    env = make(observation="pixels", panorama=1, render_mode="rgb_array", width=72)
    for seed in (0, 10):
        observation, _ = env.reset(seed=seed)
        assert observation["panoramas"].shape == (3 * 36, 72, 3)
        assert observation["panoramas"].std() > 10
        assert env.render().shape == (512, 1024, 3)
    env.close()


@pytest.mark.soak
def test_a_thousand_resets_leak_no_memory():
    env = make()
    env.action_space.seed(0)
    env.reset(seed=0)
    env.step(env.action_space.sample())
    tracemalloc.start(25)
    for seed in range(1000):
        env.reset(seed=seed % 10)
        env.step(env.action_space.sample())
        # Python keeps freed objects for reuse, up to a bound that the first episodes come near.
        if seed == 500:
            early = traced_after_collection()
    # Less than 100 bytes a reset: no array, no list and no object stays.
    assert traced_after_collection() - early < 50_000
    tracemalloc.stop()


def traced_after_collection() -> int:
    """Bytes that calls from this file hold: threads that other tests have left behind allocate as well."""
    gc.collect()
    from_here = tracemalloc.Filter(True, __file__, all_frames=True)
    traces = tracemalloc.take_snapshot().filter_traces([from_here]).traces
    return sum(trace.size for trace in traces)


def act_randomly(world: str, steps: int) -> None:
    env = gymnasium.make(NAME, world=world)
    env.action_space.seed(0)
    env.reset(seed=0)
    for k in range(steps):
        observation, reward, terminated, truncated, info = env.step(env.action_space.sample())
        assert np.isfinite(reward)
        assert np.isfinite(list(info.values())).all()
        if k % 50 == 0:
            assert env.observation_space.contains(observation)
        if terminated or truncated:
            env.reset()


def test_random_actions():
    act_randomly("pilsun", 100)


@pytest.mark.soak
@pytest.mark.parametrize("world", sorted(catalogue.WORLDS))
def test_many_random_actions(world):
    act_randomly(world, 4000)
