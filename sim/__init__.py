"""The simulator: robots and people act in a world, and what they see becomes sequences that the tracker reads.

Read `recording/record.py` first. Importing `sim` registers the gymnasium environment `pilsim/Placement-v0`.
"""

import os
import tempfile
from pathlib import Path

# Matrices here are small: with a second thread OpenBLAS waits more than it works (the filter takes twice as long), and its sums are other numbers.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# Numba refuses to compile with a cache that it can write nowhere: in containers neither the package nor the home may be writable.
if not any(os.access(folder, os.W_OK) for folder in (Path(__file__).parent, Path.home() / ".cache", Path.home())):
    os.environ.setdefault("NUMBA_CACHE_DIR", str(Path(tempfile.gettempdir(), f"pilsim-numba-{getattr(os, 'getuid', int)()}")))

import gymnasium

gymnasium.register("pilsim/Placement-v0", "sim.placement.env:Placement", max_episode_steps=240)
