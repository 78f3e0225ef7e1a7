"""MuJoCo, imported where MUJOCO_GL names an OpenGL that this computer cannot load, too.

`import mujoco` loads that OpenGL, and fails where it is missing, in ways that differ by backend. Physics and scenes draw nothing, and need none.
Modules take MuJoCo from here: `from worlds.engine import mujoco`.
"""

from __future__ import annotations

import importlib
import os
from typing import TYPE_CHECKING

__all__ = ["mujoco"]

READ = ("MUJOCO_GL", "PYOPENGL_PLATFORM")
"""Environment variables that choose an OpenGL; MuJoCo sets the second one while it loads the first."""


def _load() -> object:
    """The module mujoco, without its own renderer where that cannot be loaded. Raises ImportError where MuJoCo is missing."""
    given = {name: os.environ.get(name) for name in READ}
    try:
        return importlib.import_module("mujoco")
    except ImportError:
        raise
    # RuntimeError for an unknown value, AttributeError or OSError for a missing library: PyOpenGL promises no kind.
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
