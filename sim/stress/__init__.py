"""`pilsim stress`: sweeps as data, injected faults, trials, and the analysis of each: error causes, bounds, ablation, worst moments.

Read `sweeps.py` first."""

from sim.stress.sweeps import SWEEPS, Case, cases

__all__ = ["SWEEPS", "Case", "cases"]
