"""Semantic class of every geom of a simulation's model."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sim.rendering.draw_list import ABSENT, GROUPS
from worlds.engine import mujoco
from worlds.semantics import CLASSES, class_of


def classes(model: mujoco.MjModel) -> NDArray[np.uint8]:
    """Class (ngeom,) of every geom, from its name or its body's name; 0 for geoms that are not drawn.

    Raises ValueError for a drawn geom whose name worlds.semantics does not know.
    """
    out = np.zeros(model.ngeom, np.uint8)
    for k in np.flatnonzero(np.isin(model.geom_group, (*GROUPS, ABSENT)) & (model.geom_rgba[:, 3] > 0)):
        name, body = model.geom(int(k)).name, model.body(int(model.geom_bodyid[k])).name
        if body.startswith("person_"):
            out[k] = CLASSES.index("person")
        elif body.startswith("robot_"):
            out[k] = CLASSES.index("robot")
        else:
            out[k] = class_of(name)
    return out
