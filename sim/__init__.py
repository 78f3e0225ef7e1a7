"""The simulator: robots and people act in a world, and what they see becomes sequences that the tracker reads.

Read `recording/record.py` first. Importing `sim` registers the gymnasium environment `pilsim/Placement-v0`.
"""

import os
import tempfile
from contextlib import suppress
from pathlib import Path

# Matrices here are small: with a second thread OpenBLAS waits more than it works (the filter takes twice as long), and its sums are other numbers.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import gymnasium


def _choose_numba_cache() -> None:
    """Name a folder in the temporary one where numba can cache nowhere else: in containers neither the package nor the home may be writable."""
    if any(os.access(folder, os.W_OK) for folder in (Path(__file__).parent, Path.home() / ".cache", Path.home())):
        return
    user = getattr(os, "getuid", int)()
    folder = Path(tempfile.gettempdir(), f"pilsim-numba-{user}")
    with suppress(OSError):
        folder.mkdir(mode=0o700, exist_ok=True)
        # A cache holds code: a folder that somebody else made under this name is not used.
        if folder.stat().st_uid == user:
            os.environ.setdefault("NUMBA_CACHE_DIR", str(folder))


_choose_numba_cache()
gymnasium.register(
    "pilsim/Placement-v0", "sim.placement.env:Placement", max_episode_steps=240, vector_entry_point="sim.placement.vector_env:PlacementVector"
)
