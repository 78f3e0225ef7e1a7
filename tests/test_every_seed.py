"""Every world on two of ten seeds: it can be walked, is irregular, and has its ground where rays find it. On one, people walk as people do."""

import numpy as np
import pytest

from sim.scenario import Scenario
from sim.simulation.simulation import Simulation
from tests.sim.footfalls import Footfalls
from tests.worlds.inspection import can_be_walked, rays_hit_the_ground
from worlds import catalogue
from worlds.difficulty import measure

OPEN = ("campus", "forest", "hills", "quarry")
LEVEL = ("campus", "hall")
"""Worlds like real places with level ground."""
ROTATION = [(name, (k + turn) % 10) for k, name in enumerate(sorted(catalogue.WORLDS)) for turn in (0, 5)]
"""Worlds and seeds: every seed of ten is that of some world."""


@pytest.mark.soak
@pytest.mark.parametrize(("name", "seed"), ROTATION)
def test_every_world_holds_on_every_seed(name: str, seed: int) -> None:
    world = catalogue.build(name, np.random.default_rng(seed), 0.5)
    can_be_walked(world, 74 if name in OPEN else 10)
    assert name in LEVEL or measure(world).irregular_share >= 0.15
    rays_hit_the_ground(world)
    if seed < 5:
        footfalls = Footfalls(Simulation(Scenario(world=name, seed=seed, robots=1, people=6, rate=12.0), world), 96)
        assert len(footfalls.gap) > 600
        footfalls.are_human()
