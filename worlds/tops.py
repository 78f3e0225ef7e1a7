"""How high what stands on the terrain is: what hides people from view, and what counts as an occluder."""

from __future__ import annotations

import mujoco
import numpy as np

from worlds.heightfield import Heightfield
from worlds.world import World

HEADROOM = 2.0
"""m over the floor: what ends above hides nobody."""
_FAR = 50.0


def tops(world: World) -> Heightfield:
    """The terrain with what stands on it, as heights on the grid of the ground, by rays from above.

    What hangs higher than people are tall (beams, lintels, vaults) hides nobody and is left out; what they could see under (a table) is not.
    """
    model = world.spec.copy().compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    nodes = world.ground.nodes.reshape(-1, 2)
    floors = world.terrain.height_at(nodes)
    heights = [_top(model, data, point, floor) for point, floor in zip(nodes.tolist(), floors.tolist(), strict=True)]
    return world.ground.with_heights(np.array(heights).reshape(world.ground.heights.shape))


def _top(model: mujoco.MjModel, data: mujoco.MjData, point: list[float], floor: float) -> float:
    """Height of the highest thing over a point (2,) m that reaches down among people, else of the floor."""
    down, geom, z = np.array([0.0, 0.0, -1.0]), np.zeros(1, np.int32), floor + _FAR
    entered: dict[int, float] = {}
    while True:
        distance = mujoco.mj_ray(model, data, np.array([*point, z]), down, None, 1, -1, geom, None)
        surface = z - distance
        if distance < 0 or surface <= floor + 0.01:
            # Whatever was entered and not left goes into the ground.
            return max(entered.values(), default=floor)
        if int(geom[0]) not in entered:
            entered[int(geom[0])] = surface
        else:
            top = entered.pop(int(geom[0]))
            if surface < floor + HEADROOM:
                return max(top, *entered.values()) if entered else top
        z = surface - 1e-4
