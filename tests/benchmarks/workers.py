"""Rendering speed of one and two worker processes: panoramas of pilsun, each process on one thread."""

from __future__ import annotations

import multiprocessing
import os
import resource
import time
from multiprocessing.pool import Pool

import numpy as np

from sim.parallel.pool import ONE_THREAD
from sim.rendering.panorama import PanoramaRenderer
from sim.scenario import Scenario
from sim.simulation.simulation import Simulation
from tracker.geometry.cameras import Panorama

ROUNDS = 20


def work(seed: int) -> tuple[float, float, float]:
    """Start and end time of ROUNDS x 4 panoramas, s, and peak memory, GiB, of one worker."""
    simulation = Simulation(Scenario(seed=seed))
    poses = [simulation.T_world_robot(robot) @ simulation.mount(robot) for robot in simulation.robots]
    ids = simulation.persons.tolist()
    with PanoramaRenderer(simulation.model, Panorama(1024, 512), simulation.person_of_geom.astype(np.uint16)) as renderer:
        renderer.unoccluded(simulation.data, poses, ids)
        renderer.render(simulation.data, poses)
        started = time.time()
        for _ in range(ROUNDS):
            renderer.render(simulation.data, poses)
            renderer.unoccluded(simulation.data, poses, ids)
        return started, time.time(), resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20


def rate(pool: Pool, workers: int) -> tuple[float, float]:
    """Panoramas per second of a number of workers at once, and the largest peak memory of one, GiB."""
    found = np.array(pool.map(work, range(workers), chunksize=1))
    # The rates of workers are added, so that different start times do not count.
    return float((4 * ROUNDS / (found[:, 1] - found[:, 0])).sum()), float(found[:, 2].max())


def main() -> None:
    os.environ |= dict.fromkeys(ONE_THREAD, "1")
    rates = {}
    for workers in (1, 2):
        with multiprocessing.get_context("spawn").Pool(workers) as pool:
            rates[workers], memory = rate(pool, workers)
        print(f"{workers} workers: {rates[workers]:5.1f} panoramas/s, {memory:.2f} GiB peak memory each", flush=True)
    print(f"two are {rates[2] / rates[1]:.2f} x one")


if __name__ == "__main__":
    main()
