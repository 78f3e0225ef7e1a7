"""Speed of the simulation on one core without rendering, and the error of wheel odometry in each world.

python -m tests.benchmarks.simulation [--worlds]
"""

from __future__ import annotations

import sys
import time

from sim.scenario import Scenario
from sim.simulation import wheel_slip
from sim.simulation.simulation import Simulation
from worlds import catalogue

SECONDS = 10.0


def speed(people: int, timestep: float) -> float:
    """Simulated seconds per second of process time, with four rovers and a number of people on pilsun."""
    simulation = Simulation(Scenario(robots=4, people=people, timestep=timestep))
    simulation.step()
    best = 0.0
    for _ in range(3):
        start = time.process_time()
        for _ in range(round(SECONDS / simulation.scenario.period)):
            simulation.step()
        best = max(best, SECONDS / (time.process_time() - start))
    return best


def main() -> None:
    print("simulated seconds per second of one core, four rovers, pilsun, the best of three")
    print("people  at 2 ms  at 5 ms")
    for people in (10, 74):
        print(f"{people:6d}  {speed(people, 0.002):7.1f}  {speed(people, 0.005):7.1f}")
    if "--worlds" in sys.argv[1:]:
        print("\nerror of wheel odometry per metre, by slip only, in 60 s of four rovers without people")
        print("world     difficulty  error  driven  frames tipped")
        for name in sorted(catalogue.WORLDS):
            for difficulty in (0.0, 0.5, 1.0):
                found = wheel_slip.measure(Simulation(Scenario(world=name, difficulty=difficulty, people=0)), 60.0)
                print(f"{name:9s} {difficulty:10.1f} {100 * found.error:5.1f} %  {found.driven:5.1f} m  {found.tipped:6d}")


if __name__ == "__main__":
    main()
