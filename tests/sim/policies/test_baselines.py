"""Baseline policies, the roadmap on which they plan, their comparison on the same episodes, and the command."""

from __future__ import annotations

import json
import sys

import numpy as np
import pytest

from sim.cli.place import Place
from sim.cli.scenario_options import SceneOptions
from sim.placement.map import MapKey, map_of
from sim.policies.baselines import best_ring
from sim.policies.rollouts import EpisodeResult, compare, differences, draw, policy_of, run_episodes, table, text

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


@pytest.mark.parametrize("name", ["random", "static", "lloyd", "greedy"])
def test_policies_are_deterministic(name):
    first, again = (run_episodes(name, [1], OPTIONS, 12) for _ in range(2))
    assert first == again
    assert np.isfinite(list(first[0].values.values())).all()


def test_unknown_policies_are_refused(monkeypatch):
    with pytest.raises(ValueError, match="policy is 'best', needs one of random, static, lloyd, greedy, predictive"):
        policy_of("best")
    monkeypatch.setitem(sys.modules, "stable_baselines3", None)
    with pytest.raises(ValueError, match="pip install"):
        policy_of("ppo:nothing.zip")


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


@pytest.mark.soak
def test_ppo_training_is_deterministic_and_its_policy_runs(tmp_path):
    torch = pytest.importorskip("torch", reason="needs stable-baselines3 (make rl)")
    pytest.importorskip("stable_baselines3", reason="needs stable-baselines3 (make rl)")
    from sim.policies.ppo import Learned
    from sim.policies.training import train

    first, again = (train({**OPTIONS}, 1280, tmp_path / name) for name in ("ppo", "again"))
    assert (tmp_path / "ppo" / "curve.png").stat().st_size > 1000
    assert sorted(path.name for path in tmp_path.iterdir()) == ["again", "ppo"]
    weights = [Learned.read(str(file)).model.policy.state_dict() for file in (first, again)]
    assert all(torch.equal(weights[0][name], weights[1][name]) for name in weights[0])
    # The policy runs with other numbers of robots and people, too.
    assert len(run_episodes(f"ppo:{first}", [1], OPTIONS | {"robots": 2, "people": 9}, 5)) == 1


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
