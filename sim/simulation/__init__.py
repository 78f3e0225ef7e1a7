"""The physics: a world with its rovers and people, which one `mj_step` advances together.

Read `simulation.py` first."""

from sim.simulation.simulation import Simulation

__all__ = ["Simulation"]
