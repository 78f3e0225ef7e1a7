"""The simulator: robots and people move in a world, and simulated sensors give the sequences that the tracker reads.

Read `recording/record.py` first. Importing `sim` registers the gymnasium environment `pilsim/Placement-v0`.
"""

import os
import tempfile
from contextlib import suppress
from pathlib import Path

# Matrices here are small: a second OpenBLAS thread mostly waits, which doubles the time of the filter, and it changes the rounding of sums.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import gymnasium


def _choose_numba_cache() -> None:
    """Set numba's cache to a temporary folder where neither the package nor the home folder is writable, as in some containers."""
    if any(os.access(folder, os.W_OK) for folder in (Path(__file__).parent, Path.home() / ".cache", Path.home())):
        return
    user = getattr(os, "getuid", int)()
    folder = Path(tempfile.gettempdir(), f"pilsim-numba-{user}")
    with suppress(OSError):
        folder.mkdir(mode=0o700, exist_ok=True)
        # A cache holds code, so a folder of this name that another user made is not used.
        if folder.stat().st_uid == user:
            os.environ.setdefault("NUMBA_CACHE_DIR", str(folder))


_choose_numba_cache()
gymnasium.register(
    "pilsim/Placement-v0", "sim.placement.env:Placement", max_episode_steps=240, vector_entry_point="sim.placement.vector_env:PlacementVector"
)
