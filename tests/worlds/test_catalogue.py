"""Worlds by name, and what a world must be."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from worlds import catalogue
from worlds.terrain.free_space import FEET, free_space
from worlds.terrain.heightfield import Heightfield
from worlds.world import World


def test_an_unknown_world_is_told_which_there_are() -> None:
    with pytest.raises(ValueError, match=r"'atlantis'.*pilsun"):
        catalogue.build("atlantis", np.random.default_rng(0))


@pytest.mark.parametrize("difficulty", [-0.1, 1.1, float("nan")])
def test_difficulty_is_a_share(difficulty: float) -> None:
    with pytest.raises(ValueError, match="difficulty"):
        catalogue.build("pilsun", np.random.default_rng(0), difficulty)


def test_people_must_have_where_to_enter() -> None:
    ground = Heightfield.flat([[0, 0], [4, 3]], 0.1)
    space = free_space(ground, np.zeros(ground.heights.shape, dtype=bool), FEET)
    spec = mujoco.MjSpec()
    world = World("meadow", spec, ground, space, space, [[[1, 1], [2, 2]]])
    assert world.spawn.shape == (1, 2, 2)
    with pytest.raises(ValueError, match=r"not free for feet"):
        World("meadow", spec, ground, space, space, [[[0.1, 1], [2, 2]]])
    with pytest.raises(ValueError, match="shape"):
        World("meadow", spec, ground, space, space, np.zeros((0, 2, 2)))
