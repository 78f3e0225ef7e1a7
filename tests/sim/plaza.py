"""A wide, level, empty world that contains the area of PETS 2009, for tests of its cameras."""

from functools import lru_cache

import mujoco
import numpy as np

from worlds.terrain.free_space import FEET, WHEELS, free_space
from worlds.terrain.heightfield import Heightfield
from worlds.textures.materials import Canvas, add_light, add_material, add_sky, set_view
from worlds.world import World

LOW, HIGH = (-32.0, -32.0), (24.0, 24.0)


@lru_cache(maxsize=1)
def plaza() -> World:
    """A square of 56 m at z = 0."""
    ground = Heightfield.flat([LOW, HIGH], 0.5)
    spec = mujoco.MjSpec()
    paint = Canvas(*(np.array(HIGH) - LOW), 8, (128, 130, 124))
    paint.mottle(np.random.default_rng(0), paint.box, 0.3, 6.0)
    add_material(spec, "ground", paint)
    ground.add_to(spec, "ground", "ground")
    add_sky(spec, (0.6, 0.7, 0.85), (0.85, 0.9, 0.95))
    add_light(spec, (0.4, 0.3, -1.0), 1.0)
    set_view(spec, ground.extent)
    nothing = np.zeros(ground.heights.shape, dtype=bool)
    spawn = np.array([[[-10.0, -10.0], [-8.0, -8.0]]])
    return World("plaza", spec, ground, free_space(ground, nothing, FEET), free_space(ground, nothing, WHEELS), spawn)
