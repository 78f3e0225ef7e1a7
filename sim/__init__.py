"""The simulator: robots and people act in a world, and what they see becomes sequences that the tracker reads.

Read `recording/record.py` first. Importing `sim` registers the gymnasium environment `pilsim/Placement-v0`.
"""

import os

# Matrices here are small: with a second thread OpenBLAS waits more than it works (the filter takes twice as long), and its sums are other numbers.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import gymnasium

gymnasium.register("pilsim/Placement-v0", "sim.placement.env:Placement", max_episode_steps=240)
