"""Attachment of a user's MJCF to a scene: reading it, and taking its bodies without its global options."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import numpy as np

from worlds.engine import mujoco

CAMERA_AXES = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, 1.0], [-1.0, 0.0, 0.0]])
"""Rotation of a camera of ours, which looks along x with z up, in one of MuJoCo's, which looks along −z with y up."""


def read_model(path: Path) -> tuple[mujoco.MjSpec, mujoco.MjModel]:
    """The spec of an MJCF file, without its keyframes, and its model, with them.

    Raises ValueError, in one line, where MuJoCo cannot read or compile it, or where it has what is not drawn.
    """
    try:
        # Attributes that MuJoCo will drop some day are no concern of who runs a simulation today.
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
    """Attach all of a child at the origin of a scene, its names with a prefix, so that none is taken. Options and view stay those of the scene.

    Returns the frame. The child cannot be used again.
    """
    take_options(scene, child)
    frame = scene.worldbody.add_frame()
    scene.attach(child, prefix=prefix, frame=frame)
    return frame


def take_options(scene: mujoco.MjSpec, child: mujoco.MjSpec) -> None:
    """Give a child the options, the view and the sizes of the scene to which it is attached.

    MuJoCo warns, on the terminal, of each one that differs.
    """
    for mine, its in ((scene.option, child.option), (scene.stat, child.stat)):
        _copy(mine, its)
    for part in ("map", "quality", "scale", "rgba", "headlight", "global_"):
        _copy(getattr(scene.visual, part), getattr(child.visual, part))
    for name in ("njmax", "nconmax", "nkey", "memory", "nuserdata", "nstack", "nemax"):
        setattr(child, name, getattr(scene, name))


def _copy(source: Any, target: Any) -> None:
    """Copy all values."""
    for name in dir(source):
        if not name.startswith("_") and not callable(value := getattr(source, name)):
            setattr(target, name, value)
