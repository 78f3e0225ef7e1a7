"""A small walled yard on rolling ground, as a world for tests."""

from functools import lru_cache

import mujoco
import numpy as np

from worlds.terrain.free_space import Limits, free_space
from worlds.terrain.heightfield import Heightfield
from worlds.world import World

HALF = 6.0


@lru_cache(maxsize=4)
def yard(relief: float = 0.05) -> World:
    """A square of 12 m with hills of `relief` m, walls 1 m high, and one block in the middle."""
    ground = Heightfield.flat([[-HALF, -HALF], [HALF, HALF]], 0.1)
    x, y = ground.nodes[..., 0], ground.nodes[..., 1]
    ground = ground.with_heights(relief * np.sin(1.1 * x + 0.5) * np.cos(0.9 * y))
    spec = mujoco.MjSpec()
    ground.add_to(spec, "ground")
    for k, (cx, cy, a, b) in enumerate([(0, -HALF, HALF, 0.1), (0, HALF, HALF, 0.1), (-HALF, 0, 0.1, HALF), (HALF, 0, 0.1, HALF), (0, 0, 0.5, 0.5)]):
        spec.worldbody.add_geom(name=f"wall{k}", type=mujoco.mjtGeom.mjGEOM_BOX, size=[a, b, 0.5], pos=[cx, cy, 0.5], group=1)
    blocked = (np.maximum(np.abs(x), np.abs(y)) > HALF - 0.15) | (np.maximum(np.abs(x), np.abs(y)) < 0.55)
    feet = free_space(ground, blocked, Limits(np.deg2rad(35), 0.2, 0.25))
    wheels = free_space(ground, blocked, Limits(np.deg2rad(20), 0.05, 0.3))
    return World("yard", spec, ground, feet, wheels, np.array([[[-4.0, -4.0], [-3.0, -3.0]]]))
