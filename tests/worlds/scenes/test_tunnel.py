"""The tunnel: closed overhead but for its shafts, with room under what hangs over the way, and something over most of it."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from tests.worlds.inspection import compiled
from worlds.scenes.tunnel import draw
from worlds.terrain.heightfield import Array
from worlds.world import World

SEEDS = range(2)


def tunnel(seed: int) -> tuple[World, mujoco.MjModel, mujoco.MjData]:
    return compiled("tunnel", seed, 0.5 + 0.5 * seed)


def rays(seed: int, eye: Array, way: Array) -> tuple[Array, Array]:
    """Geom (n,) or −1 and distance (n,) m along rays (n, 3) from one eye (3,)."""
    _, model, data = tunnel(seed)
    n = len(way)
    geom, distance = np.zeros(n, dtype=np.int32), np.zeros(n)
    mujoco.mj_multiRay(model, data, eye, way.ravel(), None, 1, -1, geom, distance, None, n, 100.0)
    return geom, distance


@pytest.mark.parametrize("seed", SEEDS)
def test_the_sky_is_seen_only_through_shafts(seed: int) -> None:
    world = tunnel(seed)[0]
    rng = np.random.default_rng(seed)
    plan = draw(np.random.default_rng(seed), 0.5 + 0.5 * seed)
    for place in world.feet.sample(rng, 6, 0.0, 1.0):
        eye = np.array([*place, world.terrain.height_at(place[None])[0] + 1.2])
        way = rng.normal(size=(900, 3))
        way /= np.linalg.norm(way, axis=1, keepdims=True)
        geom, _ = rays(seed, eye, way)
        for ray in way[geom < 0]:
            assert ray[2] > 0
            # Over the ground it goes out where a shaft is: 5 m up at most.
            line = eye[:2] + np.linspace(0, 5 / ray[2], 400)[:, None] * ray[:2]
            off = [np.linalg.norm(line - middle, axis=1).min() - radius for middle, radius in plan.shafts]
            assert min(off) < 0.75


@pytest.mark.parametrize("seed", SEEDS)
def test_everybody_can_stand_upright_and_most_have_rock_over_them(seed: int) -> None:
    world = tunnel(seed)[0]
    covered = []
    for place in world.feet.sample(np.random.default_rng(seed), 60, 0.0, 0.4):
        foot = np.array([*place, world.terrain.height_at(place[None])[0] + 0.01])
        geom, distance = rays(seed, foot, np.array([[0, 0, 1.0]]))
        assert geom[0] < 0 or distance[0] > 1.85
        covered.append(geom[0] >= 0)
    assert np.mean(covered) > 0.8


@pytest.mark.parametrize("seed", SEEDS)
def test_ledges_hang_over_the_way_and_a_slab_bridges_the_ditch(seed: int) -> None:
    world = tunnel(seed)[0]
    over = world.feet.free_at(world.decks.roofs.mean(axis=1)[:, :2])
    assert over.sum() >= 3
    middles = world.decks.decks.mean(axis=1)
    assert world.feet.free_at(middles[:, :2]).any()
    assert world.wheels.free_at(middles[:, :2]).any()
    assert (middles[:, 2] - world.ground.height_at(middles)).max() > 0.3


@pytest.mark.parametrize("seed", SEEDS)
def test_it_is_lit_by_few_lights_of_which_one_throws_shadows(seed: int) -> None:
    model = tunnel(seed)[1]
    assert model.light_castshadow.sum() == 1
    assert model.nlight + 1 <= 8
