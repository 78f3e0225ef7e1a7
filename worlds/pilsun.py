"""A small indoor laboratory with an uneven floor."""

from __future__ import annotations

import mujoco
import numpy as np

from worlds.heightfield import Heightfield
from worlds.walkable import free_space
from worlds.world import World

NAME = "pilsun"


def build(rng: np.random.Generator, difficulty: float = 0.5) -> World:
    """A plain first version: flat floor, four walls."""
    spec = mujoco.MjSpec()
    ground = Heightfield.flat([[-7.5, -6.0], [7.5, 6.0]], 0.1)
    z = 0.05 * difficulty * np.sin(ground.nodes[..., 0] + rng.uniform(0, 6)) * np.sin(1.3 * ground.nodes[..., 1])
    z[(ground.nodes[..., 0] > 4) & (ground.nodes[..., 1] > 2)] += 0.13
    ground = ground.with_heights(z)
    ground.add_to(spec, "ground")
    for k, (x, y, a, b) in enumerate([(0, -5.6, 7.2, 0.1), (0, 5.6, 7.2, 0.1), (-7.1, 0, 0.1, 5.5), (7.1, 0, 0.1, 5.5)]):
        spec.worldbody.add_geom(name=f"wall{k}", type=mujoco.mjtGeom.mjGEOM_BOX, size=[a, b, 1.4], pos=[x, y, 1.2], group=1)
    spec.worldbody.add_light(pos=[0, 0, 10], dir=[0.3, 0.2, -1], type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL)
    spec.stat.extent, spec.stat.center = 10.0, [0, 0, 1]
    spec.visual.global_.offwidth = spec.visual.global_.offheight = 4096
    blocked = (np.abs(ground.nodes[..., 0]) > 7) | (np.abs(ground.nodes[..., 1]) > 5.5)
    feet = free_space(ground, blocked, np.deg2rad(35), 0.2, 0.25)
    wheels = free_space(ground, blocked, np.deg2rad(20), 0.05, 0.3)
    return World(NAME, spec, ground, feet, wheels, np.array([[[-6.5, -1], [-5.5, 1]], [[5.5, -1], [6.5, 1]]]))
