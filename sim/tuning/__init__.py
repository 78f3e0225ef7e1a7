"""Choice of a tracker's parameters on a population of synthetic cases: places, people and detectors drawn at random.

Read `population.py` first."""

from sim.tuning.case_file import PopulationCase
from sim.tuning.population import population
from sim.tuning.scoring import evaluate

__all__ = ["PopulationCase", "evaluate", "population"]
