"""Baseline policies, the roadmap on which they plan, their comparison on the same episodes, and the command."""

from __future__ import annotations

import base64
import json
import re
import sys
import weakref
from dataclasses import replace
from xml.etree import ElementTree

import cv2
import gymnasium
import numpy as np
import pytest

from sim.cli.options import SceneOptions
from sim.cli.place import Place, _varied
from sim.placement.config import PlacementConfig
from sim.placement.information import LOST_SIGMA, nats, predict_person, update_person
from sim.placement.map import MapKey, kept_with_map, map_of
from sim.policies.learned import KIND, shipped_policy
from sim.policies.planning import (
    FEATURES,
    FOUND_SIGMA,
    NATS_SCALE,
    PEOPLE_FEATURES,
    WAYS,
    ChoiceFeatures,
    PeopleAhead,
    _places_at,
    information_from,
    team_values,
)
from sim.policies.policy import TeamKnowledge, best_ring
from sim.policies.rollouts import EpisodeResult, compare, differences, draw, policy_of, run_episodes, table, text
from sim.policies.waypoints import CHOICES, POINT_FEATURES, choices_of

OPTIONS = {"world": "pilsun", "people": 6, "robots": 3}


def test_roadmap_paths_are_shortest_and_free():
    place = map_of(MapKey("pilsun", 0.5, 0, 6))
    roadmap = place.roadmap
    assert np.isfinite(roadmap.distance).all()
    np.testing.assert_allclose(roadmap.distance, roadmap.distance.T)
    straight = np.linalg.norm(roadmap.nodes[:, None] - roadmap.nodes, axis=2)
    assert (roadmap.distance >= straight - 1e-9).all()
    rng = np.random.default_rng(0)
    for a, b in rng.integers(len(roadmap.nodes), size=(20, 2)):
        length, node = 0.0, int(a)
        while node != b:
            step = int(roadmap.next_node[node, b])
            length, node = length + straight[node, step], step
        assert length == pytest.approx(roadmap.distance[a, b])
    assert place.free_space.free_at(roadmap.nodes).all()


def test_the_best_ring_sees_more_than_random_nodes():
    place = map_of(MapKey("pilsun", 0.5, 0, 6))
    visible, rng = place.visible_from_nodes(6.0), np.random.default_rng(0)
    twice = lambda numbers: float((visible[numbers].sum(axis=0) >= 2).mean())  # noqa: E731
    chance = np.mean([twice(rng.integers(len(visible), size=4)) for _ in range(50)])
    assert twice(best_ring(place, 4, 6.0)) > chance


@pytest.mark.parametrize("name", ["random", "static", "lloyd", "greedy", "predictive"])
def test_policies_are_deterministic(name):
    first, again = (run_episodes(name, [1], OPTIONS, 12) for _ in range(2))
    assert first == again
    assert np.isfinite(list(first[0].values.values())).all()


def test_unknown_policies_are_refused(monkeypatch, tmp_path):
    with pytest.raises(ValueError, match="policy is 'best', needs one of random, static, lloyd, greedy, predictive, learned or ppo:FILE"):
        policy_of("best")
    with pytest.raises(ValueError, match=r"nothing.zip: no such file"):
        policy_of("ppo:nothing.zip")
    old, wrong = tmp_path / "ppo.zip", tmp_path / "wrong.onnx"
    old.touch()
    wrong.write_bytes(b"no model")
    with pytest.raises(ValueError, match=r"wrong\.onnx: not a model of onnxruntime"):
        policy_of(f"ppo:{wrong}")
    monkeypatch.setitem(sys.modules, "stable_baselines3", None)
    with pytest.raises(ValueError, match="pip install"):
        policy_of(f"ppo:{old}")


@pytest.mark.parametrize("name", ["greedy", "predictive", "learned"])
def test_the_order_of_people_changes_nothing(name):
    place, rng = map_of(MapKey("pilsun", 0.5, 0, 6)), np.random.default_rng(3)
    robots = np.column_stack([rng.choice(place.roadmap.nodes, 3, replace=False), np.zeros(3)])
    position, velocity = rng.choice(place.walkable_points[:, :2], 5, replace=False), rng.normal(0, 0.5, (5, 2))
    known = TeamKnowledge(place, PlacementConfig(**OPTIONS), robots, position, velocity, np.tile(0.1 * np.eye(2), (5, 1, 1)), {})
    order = rng.permutation(5)
    other = replace(known, position=position[order], velocity=velocity[order])
    actions = []
    for knowledge in (known, other):
        policy = policy_of(name)
        policy.begin(knowledge, np.random.default_rng(0))
        actions.append(policy.act(knowledge))
    np.testing.assert_array_equal(*actions)


def test_information_of_a_plan_grows_with_views():
    place = map_of(MapKey("pilsun", 0.5, 0, 6))
    position = place.walkable_points[[50, 90], :2]
    config = PlacementConfig(**OPTIONS, detector_model="fairmot")
    known = TeamKnowledge(place, config, np.zeros((1, 3)), position, np.zeros((2, 2)), np.tile(np.eye(2), (2, 1, 1)), {})
    ahead = PeopleAhead.of(known, np.array([1.5]))
    table = information_from(known, place.roadmap.nodes[:, None], ahead)
    seen = table[:, 0].any(axis=(2, 3)).sum(axis=1)
    alone = team_values(ahead, 3, table, [])
    assert (alone[seen == 0] == alone.min()).all()
    assert alone[seen == 2].min() > alone[seen == 0].max()
    assert (team_values(ahead, 3, table, [table[int(np.argmax(alone))]]) >= alone.max() - 1e-9).all()


def test_information_of_a_plan_is_that_of_each_person_by_themself():
    rng, times = np.random.default_rng(3), np.array([1.5, 3.0, 7.5])
    ahead = PeopleAhead(times, np.zeros((3, 4, 2)), np.repeat(np.diag([0.5, 0.4, 0.2, 0.2])[None], 4, axis=0), 0.25)
    root = rng.normal(size=(6, 3, 4, 2, 2))
    # Most people are not seen from most ways, and one only late.
    own = root @ root.swapaxes(-1, -2) * (rng.random((6, 3, 4, 1, 1)) < 0.3)
    others = [own[0] + 0.1 * np.eye(2), own[5]]
    expected = np.zeros(6)
    for w, k in np.ndindex(6, 4):
        P = ahead.bounds[k].copy()
        for t, step in enumerate(np.diff(times, prepend=0.0)):
            predict_person(P, step)
            update_person(P, 9 * (own[w, t, k] + others[0][t, k] + others[1][t, k]))
            expected[w] += 0.25 * nats(P) / 3
    np.testing.assert_allclose(team_values(ahead, 9, own, others), expected, rtol=1e-12)


def test_planned_robots_turn_then_drive_along_the_roadmap_and_stop_at_the_goal():
    nodes = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 2.0]])
    next_node = np.array([[0, 1, 1], [0, 1, 2], [1, 1, 2]], dtype=np.int32)
    times = np.array([1.0, 2.0, 3.0, 9.0])
    ways = _places_at(np.array([0.0, 0.0, 0.0]), 0, np.array([0, 2]), (nodes, next_node), (times, 0.8, 0.8))
    np.testing.assert_allclose(ways[0], 0.0)
    np.testing.assert_allclose(ways[1], [[0.8, 0.0], [1.0, 0.6], [1.0, 1.4], [1.0, 2.0]])
    # A robot that faces away turns half around first.
    ways = _places_at(np.array([0.0, 0.0, np.pi]), 0, np.array([2]), (nodes, next_node), (np.array([np.pi / 0.8, np.pi / 0.8 + 1.0]), 0.8, 0.8))
    np.testing.assert_allclose(ways[0], [[0.0, 0.0], [0.8, 0.0]], atol=1e-9)


def test_sampled_ways_lead_where_people_walk_and_around_what_is_in_the_way():
    place, times = map_of(MapKey("ruins", 0.5, 0, 6)), np.array([1.5, 3.0, 7.5])
    rng, count = np.random.default_rng(0), 40
    position, angle = rng.choice(place.roadmap.nodes, count, replace=False), rng.uniform(-np.pi, np.pi, count)
    velocity = np.column_stack([np.cos(angle), np.sin(angle)])
    velocity[:10] = 0.0
    known = TeamKnowledge(place, PlacementConfig(**OPTIONS), np.zeros((1, 3)), position, velocity, np.tile(np.eye(2), (count, 1, 1)), {})
    ahead = PeopleAhead.sampled(known, times)
    assert ahead.feet.shape == (3, count * WAYS, 2)
    assert ahead.bounds.shape == (count * WAYS, 4, 4)
    assert ahead.probability * WAYS == 1.0
    gone = ahead.feet.reshape(3, count, WAYS, 2) - position[:, None]
    np.testing.assert_allclose(gone[:, :10], 0.0, atol=1e-6)
    assert (np.linalg.norm(gone, axis=3) <= times[:, None, None]).all()
    # Most lead where people walk, on free ground, and the ways of a person differ.
    assert (np.einsum("tkwc,kc->tkw", gone, velocity)[-1, 10:].mean(axis=1) > 1.0).mean() > 0.8
    assert np.ptp(gone[-1, 10:], axis=1).max(axis=1).mean() > 1.5
    assert place.free_space.free_at(ahead.feet[-1]).mean() > 0.8


def test_options_of_teams_have_each_value_equally_often():
    pytest.importorskip("stable_baselines3", reason="needs stable-baselines3 (make rl)")
    from sim.policies.vector_env import options_of_teams

    found = options_of_teams({"people": 9}, _varied(("world=hall,hills", "robots=2,3,4")), 12)
    for name, values in (("world", ("hall", "hills")), ("robots", (2, 3, 4))):
        assert [sum(one[name] == value for one in found) for value in values] == [12 // len(values)] * len(values)
    assert all(one["people"] == 9 for one in found)
    for said, needed in (("robots=two", "int values"), ("robots", "int values"), ("map_seed=3", "NAME=VALUE"), ("action=velocity", "NAME=VALUE")):
        with pytest.raises(ValueError, match=f"--train-over is {said}, needs {needed}"):
            _varied((said,))


@pytest.mark.parametrize(("robots", "known"), [(1, 3), (3, 3), (3, 0), (2, 9)])
def test_values_of_choices_are_those_of_predictive_control_among_them(robots, known):
    place, rng = map_of(MapKey("pilsun", 0.5, 0, 6)), np.random.default_rng(robots)
    poses = np.column_stack([rng.choice(place.roadmap.nodes, robots, replace=False), np.zeros(robots)])
    position, velocity = rng.choice(place.walkable_points[:, :2], known, replace=False), rng.normal(0, 0.5, (known, 2))
    config = PlacementConfig(**OPTIONS | {"robots": robots})
    features = ChoiceFeatures(knowledge := TeamKnowledge(place, config, poses, position, velocity, np.tile(0.1 * np.eye(2), (known, 1, 1)), {}))
    choices, people = features.update(knowledge)
    assert choices.shape == (robots, CHOICES, FEATURES)
    # No more people than the environment has.
    assert people.shape == (robots, min(known, 6), CHOICES, PEOPLE_FEATURES)
    value = choices[..., -1]
    np.testing.assert_array_equal(value.max(axis=1), 0.0)
    assert value.min() >= -5.0
    if known == 3 and robots == 1:
        # What a robot adds about all people, with what it may find, is the value.
        found = people[0, ..., 2].sum(axis=0)
        unknown = 3 * 2 * np.log(LOST_SIGMA / FOUND_SIGMA) / NATS_SCALE
        assert np.abs((found - found.max()) - value[0]).max() < unknown
    chosen = features.chosen(np.full(robots, 3))
    np.testing.assert_array_equal(chosen, choices_of(place)[0][place.roadmap.nearest(poses[:, :2]), 3])


def test_an_untrained_network_takes_the_choice_with_the_highest_value():
    torch = pytest.importorskip("torch", reason="needs stable-baselines3 (make rl)")
    pytest.importorskip("stable_baselines3", reason="needs stable-baselines3 (make rl)")
    from sim.policies.vector_env import ChoiceNetwork, row_length

    torch.manual_seed(0)
    network, rng = ChoiceNetwork(CHOICES, FEATURES, PEOPLE_FEATURES), np.random.default_rng(0)
    rows = rng.uniform(-1, 1, (50, row_length(4))).astype(np.float32)
    scores, _ = network(torch.as_tensor(rows))
    best = rows[:, : CHOICES * FEATURES].reshape(50, CHOICES, FEATURES)[..., -1].argmax(axis=1)
    assert (scores.argmax(dim=1).numpy() == best).mean() > 0.9


@pytest.mark.command
def test_policies_of_earlier_versions_are_read_and_run(tmp_path):
    ppo = pytest.importorskip("stable_baselines3", reason="needs stable-baselines3 (make rl)").PPO
    from sim.policies.vector_env import ChoicePolicy, TeamVecEnv

    # 0.4.0 had nine features of each choice, and none of people.
    envs = TeamVecEnv([OPTIONS])
    envs.observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (CHOICES * POINT_FEATURES,), np.float32)
    ppo(ChoicePolicy, envs, n_steps=2, batch_size=6, policy_kwargs={"choices": CHOICES, "parts": POINT_FEATURES}, seed=0).save(tmp_path / "old.zip")
    assert np.isfinite(list(run_episodes(f"ppo:{tmp_path / 'old.zip'}", [1], OPTIONS, 5)[0].values.values())).all()
    # An ONNX file of another version is refused in a line.
    onnx = pytest.importorskip("onnx", reason="needs onnx (make rl)")
    graph = onnx.load(shipped_policy())
    onnx.helper.set_model_props(graph, {"pilsim": json.dumps(KIND | {"version": 1})})
    onnx.save(graph, tmp_path / "one.onnx")
    with pytest.raises(ValueError, match=r"one\.onnx: is no placement policy of version 2"):
        policy_of(f"ppo:{tmp_path / 'one.onnx'}")


def test_what_is_cached_with_a_map_goes_with_it():
    calls: list[float] = []

    @kept_with_map
    def counted(place, number):
        calls.append(number)
        return number

    first, other = (replace(map_of(MapKey("pilsun", 0.5, 0, 6))) for _ in range(2))
    assert [counted(first, 1.0), counted(first, 1.0), counted(first, 2.0), counted(other, 1.0)] == [1.0, 1.0, 2.0, 1.0]
    assert calls == [1.0, 2.0, 1.0]
    gone = weakref.ref(first)
    del first
    assert gone() is None


@pytest.mark.command
def test_the_page_has_tables_and_videos_of_episodes(tmp_path, capsys):
    scene = SceneOptions(difficulty=0.5, robots=2, people=3)
    Place(policy=("static", "predictive"), worlds=("pilsun", "hall"), episodes=2, scene=scene, steps=4, page=tmp_path / "page").run()
    said, page = capsys.readouterr().out, (tmp_path / "page" / "index.html").read_text(encoding="utf-8")
    assert "pilsun, 4 decisions each" in said
    assert "hall, 4 decisions each" in said
    assert "The worst episode of predictive in hall" in page
    # Two worlds, two policies, the best and the worst episode.
    videos = re.findall(r"data:image/webp;base64,([^\"]+)", page)
    assert len(videos) == 2 * 2 * 2
    frames = cv2.imdecodeanimation(np.frombuffer(base64.b64decode(videos[0]), dtype=np.uint8))[1].frames
    assert len(frames) == 4
    assert np.abs(frames[0].astype(int) - frames[3]).max() > 60
    ElementTree.fromstring(page)


@pytest.mark.command
def test_the_command_prints_json(capsys):
    scene = SceneOptions(world="pilsun", difficulty=0.5, robots=2, people=3)
    Place(policy=("random",), episodes=2, scene=scene, steps=4, json=True).run()
    said = json.loads(capsys.readouterr().out)
    assert said["means"]["random"]["seen"]["count"] == 2
    assert [episode["seed"] for episode in said["episodes"]] == [0, 1]


@pytest.mark.soak
def test_planned_information_is_more_than_that_of_random_goals():
    names = ("random", "greedy", "predictive")
    found = table([outcome for name in names for outcome in run_episodes(name, range(200, 208), {"world": "ruins", "people": 20}, 60)])
    for name in names[1:]:
        assert found[name]["information"].mean > found["random"]["information"].mean
        assert found[name]["seen"].mean > found["random"]["seen"].mean


@pytest.mark.command
def test_an_interrupted_training_resumes_with_the_episodes_that_follow(tmp_path):
    pytest.importorskip("stable_baselines3", reason="needs stable-baselines3 (make rl)")
    import torch

    from sim.policies.training import _new_or_resumed, _save
    from sim.policies.vector_env import TeamVecEnv, training_seed

    envs = TeamVecEnv([OPTIONS] * 2)
    model, curve = _new_or_resumed(envs, tmp_path, 1280, 7)
    # 120 choices of 6 robots: each team has run one episode and begun its second.
    model.learn(720)
    _save(model, curve, tmp_path)
    resumed = TeamVecEnv([OPTIONS] * 2)
    _new_or_resumed(resumed, tmp_path, 1280, 7)
    assert [team.played for team in resumed.teams] == [1, 1]
    assert [team.played for team in envs.teams] == [2, 2]
    # No two episodes of a training are the same.
    assert len({training_seed(team, episode, 2) for team in range(2) for episode in range(50)}) == 100
    assert torch.initial_seed() == 7 + 720


@pytest.mark.soak
def test_ppo_training_is_deterministic_and_its_policy_runs(tmp_path):
    pytest.importorskip("torch", reason="needs stable-baselines3 (make rl)")
    pytest.importorskip("stable_baselines3", reason="needs stable-baselines3 (make rl)")
    from sim.policies.training import train

    varied = {"world": ["pilsun", "hall"], "robots": [2, 3, 4]}
    first, again = (train({**OPTIONS}, 5760, tmp_path / name, varied=varied) for name in ("ppo", "again"))
    assert (tmp_path / "ppo" / "curve.png").stat().st_size > 1000
    assert sorted(path.name for path in tmp_path.iterdir()) == ["again", "ppo"]
    assert first.read_bytes() == again.read_bytes()
    # The policy runs with other numbers of robots and people, too, and the model of stable-baselines3 is the same policy.
    found = [run_episodes(f"ppo:{file}", [1], OPTIONS | {"robots": 2, "people": 9}, 5) for file in (first, first.with_name("ppo.zip"))]
    assert found[0][0].values == found[1][0].values


def results(workers: int) -> list[EpisodeResult]:
    options = {"world": "pilsun", "people": 4, "robots": 2}
    return [result for some in compare(("random", "static"), range(9, 12), options, 6, workers) for result in some]


@pytest.mark.command
def test_results_do_not_depend_on_the_number_of_workers():
    alone = results(1)
    assert [(o.policy, o.seed) for o in alone] == [(name, seed) for name in ("random", "static") for seed in (9, 10, 11)]
    assert results(2) == alone
    with pytest.raises(ValueError, match="workers is 0, needs 1 to 1024"):
        list(compare(("random",), range(1), OPTIONS, 1, 0))


def test_differences_are_paired_by_seed():
    # The second is better by 0.1 in every episode, though episodes differ by much more.
    found = [
        EpisodeResult("a", 0, {"seen": 0.1}),
        EpisodeResult("a", 1, {"seen": 0.7}),
        EpisodeResult("b", 0, {"seen": 0.2}),
        EpisodeResult("b", 1, {"seen": 0.8}),
    ]
    paired = differences(found)
    assert list(paired) == ["b"]
    assert paired["b"]["seen"].mean == pytest.approx(0.1)
    assert paired["b"]["seen"].low == pytest.approx(0.1)
    assert "difference from a, paired by seed" in text(table(found), paired)
    assert differences(found[:2]) == {}


def test_the_plot_leaves_one_file(tmp_path):
    found = table([EpisodeResult("a", seed, {"seen": 0.1 * seed, "seen_twice": 0.0, "information": 4.5}) for seed in range(3)])
    draw(found, "three episodes", tmp_path / "means.png")
    assert [path.name for path in tmp_path.iterdir()] == ["means.png"]
