"""Ruins: arches that one walks under, walls that hide, slabs that one walks over."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from tests.worlds.inspection import compiled
from worlds.scenes.ruins import SPRING, draw

CASES = [(0, 0.0), (2, 1.0)]


@pytest.mark.parametrize(("seed", "difficulty"), CASES)
def test_arches_are_walked_under(seed: int, difficulty: float) -> None:
    world, model, data = compiled("ruins", seed, difficulty)
    arches = draw(np.random.default_rng(seed), difficulty).arches
    geom = np.zeros(1, dtype=np.int32)
    free = [world.feet.free_at(middle[None])[0] for middle, _, _ in arches]
    assert np.mean(free) > 0.8
    for middle, _, span in arches:
        z = world.terrain.height_at(middle[None])[0]
        d = mujoco.mj_ray(model, data, np.array([*middle, z + 0.02]), np.array([0, 0, 1.0]), None, 1, -1, geom, None)
        assert model.geom(geom[0]).name.startswith("arch")
        assert SPRING + span / 2 - 0.6 < d < SPRING + span / 2 + 0.3


def test_the_harder_the_less_is_seen() -> None:
    """Of pairs of people's heads anywhere, more are hidden from each other."""
    shares = []
    for seed, difficulty in CASES:
        world, model, data = compiled("ruins", seed, difficulty)
        places = world.feet.sample(np.random.default_rng(0), 40, 0.0, 0.8)
        eyes = np.column_stack([places, world.terrain.height_at(places) + 1.5])
        hidden, geom = 0, np.zeros(1, dtype=np.int32)
        for a, b in zip(eyes, np.roll(eyes, 7, axis=0), strict=True):
            length = np.linalg.norm(b - a)
            d = mujoco.mj_ray(model, data, a, (b - a) / length, None, 1, -1, geom, None)
            hidden += 0 <= d < length
        shares.append(hidden / len(eyes))
    assert shares[1] > shares[0]
    assert shares[1] > 0.3
