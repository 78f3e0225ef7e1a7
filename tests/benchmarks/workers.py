"""One and two workers: processes that are spawned and draw panoramas of pilsun, each on one thread."""

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
    """When a worker began and ended its ROUNDS x 4 panoramas, and the memory that it took at most, GiB."""
    simulation = Simulation(Scenario(seed=seed))
    poses = [simulation.T_world_robot(robot) @ simulation.T_body_camera for robot in simulation.robots]
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
    """Panoramas a second of so many workers at once, and the greatest memory of one, GiB."""
    found = np.array(pool.map(work, range(workers), chunksize=1))
    # Each worker's own rate while it drew: that they do not begin at the same instant is left out.
    return float((4 * ROUNDS / (found[:, 1] - found[:, 0])).sum()), float(found[:, 2].max())


def main() -> None:
    os.environ |= dict.fromkeys(ONE_THREAD, "1")
    rates = {}
    for workers in (1, 2):
        with multiprocessing.get_context("spawn").Pool(workers) as pool:
            rates[workers], memory = rate(pool, workers)
        print(f"{workers} workers: {rates[workers]:5.1f} panoramas/s, {memory:.2f} GiB at most each", flush=True)
    print(f"two are {rates[2] / rates[1]:.2f} x one")


if __name__ == "__main__":
    main()
