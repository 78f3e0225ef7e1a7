"""Growth of time and memory with the size of a run: people, cameras, resolution, frames, workers and sequences.

    python -m tests.benchmarks growth
    python -m tests.benchmarks.growth people resolution     # some of them

Each point is a process of its own, so that its peak memory is its own. Time is processor time where it is called so. The plots are in growth.png.
"""

from __future__ import annotations

import json
import os
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from sim.datasets.generation import FILE, Plan, generate
from sim.datasets.presets import PRESETS
from sim.parallel.pool import ONE_THREAD
from sim.recording.drawing_workers import DrawingWorkers
from sim.rendering.panorama import PanoramaRenderer
from sim.scenario import Scenario
from sim.simulation.simulation import Simulation
from tracker.geometry.cameras import Panorama
from tracker.io.atomic import write_text

PICTURE = Path(__file__).parent / "growth.png"
WIDTH, PEOPLE = 1024, 10
SLEEP = 0.02
"""s that a stand-in for the drawing of one moment sleeps."""
POINTS: dict[str, tuple[int, ...]] = {
    "people": (1, 10, 50, 100, 200, 500),
    "cameras": (1, 2, 4, 8, 16, 32),
    "resolution": (512, 1024, 2048, 4096),
    "frames": (1_000, 10_000, 100_000),
    "workers": (1, 2, 4, 8, 16, 32, 64),
    "sequences": (100, 1_000, 10_000),
}
"""Measurement → sizes."""


def memory() -> float:
    """Peak memory of this process, MiB."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def drawn(people: int, width: int, cameras: int = 4) -> dict[str, float]:
    """Processor time of a panorama with truth, ms, and of a step of a frame."""
    # Crowds of more than 100 do not fit into pilsun.
    simulation = Simulation(Scenario(people=people, world="pilsun" if people <= 100 else "campus"))
    robots = [simulation.T_world_robot(robot) @ simulation.T_body_camera for robot in simulation.robots]
    poses = [robots[k % len(robots)] for k in range(cameras)]
    with PanoramaRenderer(simulation.model, Panorama(width, width // 2), simulation.person_of_geom.astype(np.uint16)) as renderer:

        def draw() -> None:
            renderer.render(simulation.data, poses)
            renderer.unoccluded(simulation.data, poses, simulation.persons.tolist())

        out = {"ms a panorama": least(draw) / cameras}
    out["ms a simulated frame"] = least(simulation.step)
    return out


def least(action: Callable[[], Any], runs: int = 3) -> float:
    """Processor time, ms: the least of some runs after the first."""
    action()
    times = []
    for _ in range(runs):
        started = time.process_time()
        action()
        times.append(time.process_time() - started)
    return 1e3 * min(times)


def simulated(frames: int) -> dict[str, float]:
    """Memory before and after frames without rendering, two rovers and four people."""
    simulation = Simulation(Scenario(people=4, robots=2))
    for _ in range(100):
        simulation.step()
    before, started = memory(), time.process_time()
    for _ in range(frames):
        simulation.step()
    return {"ms a frame": 1e3 * (time.process_time() - started) / frames, "MiB more": memory() - before}


class SleepingWorkers(DrawingWorkers):
    """The queue of drawing workers, which sleep in place of drawing."""

    def _call(self, moment: Any) -> Any:
        time.sleep(SLEEP)
        return moment


def scheduled(workers: int) -> dict[str, float]:
    """Moments a second through the queue of drawing workers, and their share of workers / SLEEP."""
    count = 40 * workers
    queue: Any = SleepingWorkers(None, workers)  # type: ignore[arg-type]
    started = time.perf_counter()
    assert list(queue.draw(range(count))) == list(range(count))
    rate = count / (time.perf_counter() - started)
    return {"moments a second": rate, "share of the best": rate * SLEEP / workers}


def listed(sequences: int) -> dict[str, float]:
    """Seconds of the summary of a dataset of so many sequences, and of resuming it where all is there. The sequences are links to one."""
    from tracker.datasets.summary import summarize

    with tempfile.TemporaryDirectory() as name:
        preset = PRESETS["pilsun"]
        preset = replace(preset, scenario=replace(preset.scenario, frames=2, people=1, robots=1, width=64), views=0)
        plan = Plan("pilsun", preset, Path(name, "set"), 1)
        generate(plan)
        for k in range(1, sequences):
            shutil.copytree(plan.out / "pilsun-00000", plan.out / f"pilsun-{k:05d}", copy_function=os.link)
        plan = replace(plan, count=sequences)
        write_text(plan.out / FILE, plan.dataset.to_json())
        started = time.perf_counter()
        summarize(plan.out)
        between = time.perf_counter()
        generate(plan)
        return {"s of info": between - started, "s of resuming": time.perf_counter() - between}


MEASURE: dict[str, Callable[[int], dict[str, float]]] = {
    "people": lambda n: drawn(n, WIDTH),
    "cameras": lambda n: drawn(PEOPLE, WIDTH, n),
    "resolution": lambda n: drawn(PEOPLE, n),
    "frames": simulated,
    "workers": scheduled,
    "sequences": listed,
}


def main(chosen: list[str] | None = None) -> None:
    found: dict[str, dict[int, dict[str, float]]] = {}
    for name in chosen or list(MEASURE):
        for size in POINTS[name]:
            command = [sys.executable, "-m", "tests.benchmarks.growth", name, str(size)]
            done = subprocess.run(command, env=os.environ | dict.fromkeys(ONE_THREAD, "1"), capture_output=True, text=True, check=False)
            if done.returncode:
                print(f"{name} {size}: {(done.stderr.strip().splitlines() or ['failed'])[-1]}", flush=True)
                continue
            found.setdefault(name, {})[size] = values = json.loads(done.stdout.splitlines()[-1])
            print(f"{name:10} {size:7}   " + "   ".join(f"{what} {value:.4g}" for what, value in values.items()), flush=True)
    plot(found, PICTURE)


def plot(found: dict[str, dict[int, dict[str, float]]], path: Path) -> None:
    """Each value against the size, with axes of logarithms; a row for each measurement."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    columns = max(len(next(iter(points.values()))) for points in found.values())
    figure, axes = plt.subplots(len(found), columns, figsize=(3.6 * columns, 2.6 * len(found)), layout="constrained", squeeze=False)
    for row, (name, points) in zip(axes, found.items(), strict=True):
        for cell in row:
            cell.set_visible(False)
        for cell, what in zip(row, next(iter(points.values())), strict=False):
            cell.set_visible(True)
            cell.plot(list(points), [values[what] for values in points.values()], marker="o")
            cell.set(xscale="log", xlabel=name, ylabel=what, ylim=(0, None))
    figure.savefig(path, dpi=80)


if __name__ == "__main__":
    if len(sys.argv) == 3 and sys.argv[2].isdigit():
        print(json.dumps(MEASURE[sys.argv[1]](int(sys.argv[2])) | {"MiB": memory()}))
    else:
        main(sys.argv[1:])
