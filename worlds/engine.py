"""MuJoCo, imported even if MUJOCO_GL names an OpenGL backend that this computer cannot load.

`import mujoco` loads that backend. If it is missing, the import fails in ways that differ by backend. Physics and scenes need no OpenGL.
Modules take MuJoCo from here: `from worlds.engine import mujoco`.
"""

from __future__ import annotations

import importlib
import os
from typing import TYPE_CHECKING

__all__ = ["mujoco"]

READ = ("MUJOCO_GL", "PYOPENGL_PLATFORM")
"""Environment variables that choose an OpenGL backend; MuJoCo sets the second while it loads the backend of the first."""


def _load() -> object:
    """The module mujoco, without its own renderer if that cannot be loaded. Raises ImportError if MuJoCo is missing."""
    given = {name: os.environ.get(name) for name in READ}
    try:
        return importlib.import_module("mujoco")
    except ImportError:
        raise
    # RuntimeError for an unknown value, AttributeError or OSError for a missing library: PyOpenGL documents no type.
    except Exception:
        os.environ["MUJOCO_GL"] = "disable"
        try:
            return importlib.import_module("mujoco")
        finally:
            for name, value in given.items():
                os.environ.pop(name, None)
                if value is not None:
                    os.environ[name] = value


if TYPE_CHECKING:
    import mujoco as mujoco
else:
    mujoco = _load()
