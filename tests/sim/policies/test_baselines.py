"""Policies: where they stand, what they are worth, and the command that compares them."""

from __future__ import annotations

import json
import sys

import numpy as np
import pytest

import sim  # noqa: F401
from sim.placement.map import MapKey, map_of
from sim.policies.baselines import best_ring
from sim.policies.rollouts import policy_of, table, try_out

OPTIONS = {"world": "pilsun", "people": 6, "robots": 3}


def test_roads_are_shortest_ways_over_free_ground():
    place = map_of(MapKey("pilsun", 0.5, 0, 6))
    roads = place.roads
    assert np.isfinite(roads.distance).all()
    np.testing.assert_allclose(roads.distance, roads.distance.T)
    straight = np.linalg.norm(roads.places[:, None] - roads.places, axis=2)
    assert (roads.distance >= straight - 1e-9).all()
    rng = np.random.default_rng(0)
    for a, b in rng.integers(len(roads.places), size=(20, 2)):
        length, node = 0.0, int(a)
        while node != b:
            step = int(roads.onward[node, b])
            length, node = length + straight[node, step], step
        assert length == pytest.approx(roads.distance[a, b])
    assert place.room.free_at(roads.places).all()


def test_the_best_ring_sees_more_than_places_at_random():
    place = map_of(MapKey("pilsun", 0.5, 0, 6))
    sees, rng = place.sees(6.0), np.random.default_rng(0)
    twice = lambda numbers: float((sees[numbers].sum(axis=0) >= 2).mean())  # noqa: E731
    chance = np.mean([twice(rng.integers(len(sees), size=4)) for _ in range(50)])
    assert twice(best_ring(place, 4, 6.0)) > chance


@pytest.mark.parametrize("name", ["random", "static", "lloyd", "greedy"])
def test_a_policy_plays_the_same_twice(name):
    first, again = (try_out(name, [1], OPTIONS, 12) for _ in range(2))
    assert first == again
    assert np.isfinite(list(first[0].values.values())).all()


def test_unknown_policies_are_named(monkeypatch):
    with pytest.raises(ValueError, match="policy is 'best', needs one of random, static, lloyd, greedy"):
        policy_of("best")
    monkeypatch.setitem(sys.modules, "stable_baselines3", None)
    with pytest.raises(ValueError, match="pip install"):
        policy_of("ppo:nothing.zip")


def test_the_command_prints_json(capsys):
    from sim.cli.place import Place

    Place(policy=("random",), episodes=2, world="pilsun", robots=2, people=3, steps=4, json=True).run()
    said = json.loads(capsys.readouterr().out)
    assert said["means"]["random"]["seen"]["count"] == 2
    assert [episode["seed"] for episode in said["episodes"]] == [0, 1]
    with pytest.raises(ValueError, match="episodes is 0"):
        Place(episodes=0).run()


@pytest.mark.slow
def test_greedy_and_lloyd_see_more_people_twice_than_random():
    found = table([outcome for name in ("random", "lloyd", "greedy") for outcome in try_out(name, range(200, 230), {"world": "ruins"}, 240)])
    for name in ("lloyd", "greedy"):
        assert found[name]["seen_twice"].mean > found["random"]["seen_twice"].mean


@pytest.mark.slow
def test_ppo_trains_alike_with_the_same_seed_and_plays(tmp_path):
    torch = pytest.importorskip("torch", reason="needs stable-baselines3 (make rl)")
    pytest.importorskip("stable_baselines3", reason="needs stable-baselines3 (make rl)")
    from sim.policies.ppo import Learned
    from sim.policies.training import train

    first, again = (train({**OPTIONS}, 3840, tmp_path / name) for name in ("ppo", "again"))
    assert (tmp_path / "ppo" / "curve.png").stat().st_size > 1000
    assert sorted(path.name for path in tmp_path.iterdir()) == ["again", "ppo"]
    weights = [Learned.read(str(file)).model.policy.state_dict() for file in (first, again)]
    assert all(torch.equal(weights[0][name], weights[1][name]) for name in weights[0])
    # Another number of robots and people can be played with it, too.
    assert len(try_out(f"ppo:{first}", [1], OPTIONS | {"robots": 2, "people": 9}, 5)) == 1
