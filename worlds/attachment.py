"""Reading of a user's MJCF, and attachment of its bodies to a scene, without its global options."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import numpy as np

from worlds.engine import mujoco

CAMERA_AXES = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, 1.0], [-1.0, 0.0, 0.0]])
"""Rotation (3, 3) from our camera axes (x forward, z up) to MuJoCo's (−z forward, y up)."""


def read_model(path: Path) -> tuple[mujoco.MjSpec, mujoco.MjModel]:
    """The spec of an MJCF file, without its keyframes, and its model, with them.

    Raises ValueError, in one line, if MuJoCo cannot read or compile it, or if it has flexes or skins, which are not drawn.
    """
    try:
        # MuJoCo's deprecation warnings do not concern the user of a simulation.
        with warnings.catch_warnings(action="ignore"):
            spec = mujoco.MjSpec.from_file(path.as_posix())
            model = spec.copy().compile()
    except (ValueError, FileNotFoundError, mujoco.FatalError) as error:
        raise ValueError(f"{path}: MuJoCo cannot use it: {' '.join(str(error).split())[:200]}") from None
    if spec.flexes or spec.skins:
        raise ValueError(f"{path}: has {len(spec.flexes)} flexes and {len(spec.skins)} skins, which are not drawn; take them out")
    for key in list(spec.keys):
        # A keyframe has the number of joints of its own model, which is not that of the scene.
        spec.delete(key)
    return spec, model


def attach(scene: mujoco.MjSpec, child: mujoco.MjSpec, prefix: str) -> mujoco.MjsFrame:
    """Attach all of a child at the origin of a scene. The prefix keeps its names unique. Options and view stay those of the scene.

    Returns the frame. The child cannot be used again.
    """
    take_options(scene, child)
    frame = scene.worldbody.add_frame()
    scene.attach(child, prefix=prefix, frame=frame)
    return frame


def take_options(scene: mujoco.MjSpec, child: mujoco.MjSpec) -> None:
    """Give a child the options, the view and the sizes of the scene to which it is attached.

    Otherwise MuJoCo prints a warning for each one that differs.
    """
    for mine, its in ((scene.option, child.option), (scene.stat, child.stat)):
        _copy(mine, its)
    for part in ("map", "quality", "scale", "rgba", "headlight", "global_"):
        _copy(getattr(scene.visual, part), getattr(child.visual, part))
    for name in ("njmax", "nconmax", "nkey", "memory", "nuserdata", "nstack", "nemax"):
        setattr(child, name, getattr(scene, name))


def _copy(source: Any, target: Any) -> None:
    """Copy all public attributes except methods."""
    for name in dir(source):
        if not name.startswith("_") and not callable(value := getattr(source, name)):
            setattr(target, name, value)
