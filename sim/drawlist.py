"""What there is to draw: MuJoCo's scene as an array, and which of its geoms matter to which face of a cube.

MuJoCo's drawing loop does not cull, and draws every geom once in a code pass and three times with shadows. Here the geoms outside
a face's frustum are left out, except for those whose shadow may fall into it; the picture is the same.
"""

from __future__ import annotations

import ctypes
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from sim.cubemap import frustum_planes
from tracker.geometry import Array, Pose

GROUPS = (1, 1, 1, 1, 0, 0)
"""Geom groups that are drawn: 0 to 2, and 3 of the robots; 4 holds invisible collision shapes."""
SPARE = 16
"""Places in the scene beyond the model's geoms."""

GEOM = np.dtype(
    {
        "names": ["objtype", "objid", "segid", "size", "pos", "mat", "rgba", "reflectance"],
        "formats": ["i4", "i4", "i4", ("f4", 3), ("f4", 3), ("f4", (3, 3)), ("f4", 4), "f4"],
        "offsets": [8, 12, 36, 40, 52, 64, 100, 128],
        "itemsize": 256,
    }
)
"""mjvGeom of mujoco 4 (mjvisualize.h), the fields that are used here. `_as_array` checks it against the bindings."""


@dataclass(frozen=True, eq=False)
class Drawing:
    """Per face the geoms (indices into the list) that it sees, and those that its colours need: seen, or casting a shadow into it."""

    seen: list[NDArray[np.int64]]
    coloured: list[NDArray[np.int64]]


class DrawList:
    """The geoms and lights of one moment, and the choice of what is drawn next."""

    def __init__(self, model: mujoco.MjModel, instance_of_geom: NDArray[np.uint16], face: int) -> None:
        self.scene = mujoco.MjvScene(model, maxgeom=model.ngeom + SPARE)
        self.instance_of_code = np.zeros(1, np.uint16)
        self._model, self._instance_of_geom = model, instance_of_geom
        self._planes = frustum_planes(face)
        self._places = _as_array(self.scene, model.ngeom + SPARE)
        self._geoms = self._places[:0].copy()
        self._option, self._eye = _plain_option(), mujoco.MjvCamera()
