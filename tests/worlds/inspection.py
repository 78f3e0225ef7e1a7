"""Worlds that tests share, and what must hold for each: one can get about in it, and rays hit its ground where that is said to be."""

from __future__ import annotations

from functools import cache

import mujoco
import numpy as np
from scipy import ndimage

from worlds import catalogue
from worlds.world import World

ROVERS = 4
GROUND_ONLY = np.array([1, 0, 0, 0, 0, 0], dtype=np.uint8)


@cache
def built(name: str, seed: int = 1, difficulty: float = 1.0) -> World:
    """A world, built once for all tests of a process. Its spec is copied before it is changed."""
    return catalogue.build(name, np.random.default_rng(seed), difficulty)


@cache
def compiled(name: str, seed: int = 1, difficulty: float = 1.0) -> tuple[World, mujoco.MjModel, mujoco.MjData]:
    """A world with its model at rest."""
    world = built(name, seed, difficulty)
    model = world.spec.copy().compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return world, model, data


def can_be_walked(world: World, people: int) -> None:
    """Free space is in one piece, holds its spawn areas and all who shall be there."""
    rng = np.random.default_rng(0)
    for space in (world.feet, world.wheels):
        assert ndimage.label(space.free, structure=np.ones((3, 3)))[1] == 1
    assert len(world.feet.sample(rng, people, 0.1, 0.8)) == people
    assert len(world.wheels.sample(rng, ROVERS, 0.1, 1.5)) == ROVERS
    assert len(world.spawn) >= 3
    for low, high in world.spawn:
        assert world.feet.free_at(rng.uniform(low, high, (50, 2))).all()


def rays_hit_the_ground(world: World) -> None:
    """Heights and normals are those that rays find, to 1e-6, at 10,000 places, or at those of them that are in the open."""
    model = world.spec.copy().compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    low, high = world.ground.extent
    xy = np.random.default_rng(1).uniform(low + 1e-3, high - 1e-3, (10_000, 2))
    # In the open: what is below roofs is for the tests of the terrain and of the places that have them.
    xy = xy[world.terrain.height_at(np.column_stack([xy, np.full(len(xy), 100.0)])) == world.terrain.height_at(xy)]
    assert len(xy) >= 3000
    z, normal = world.terrain.height_at(xy), world.terrain.normal_at(xy)
    # A short ray: the longer it is, the less exact is where it ends.
    down, geom, found = np.array([0.0, 0.0, -1.0]), np.zeros(1, dtype=np.int32), np.zeros(3)
    for (x, y), height, up in zip(xy, z, normal, strict=True):
        distance = mujoco.mj_ray(model, data, np.array([x, y, height + 0.5]), down, GROUND_ONLY, 1, -1, geom, found)
        assert abs(distance - 0.5) < 1e-6, (x, y)
        assert up @ found > 1 - 1e-6, (x, y)
