"""Growth of time and memory with the size of a run: people, cameras, resolution, frames, landmarks, workers and sequences.

    python -m tests.benchmarks growth
    python -m tests.benchmarks.growth people frames=100000     # some of them

Each point is a forked process of its own, so that its peak memory is its own, and Linux is needed. Times are of the processor.
growth.json has the figures, growth.png the plots. Sizes that were not run keep their earlier figures.
"""

from __future__ import annotations

import atexit
import json
import os
import shutil
import sys
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import cache
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np

from sim.datasets.generation import FILE, Plan, generate
from sim.datasets.presets import PRESETS
from sim.parallel.pool import ONE_THREAD
from sim.recording.drawing import AHEAD, drawn_in_order
from sim.recording.frames import simulated_frames
from sim.recording.tracker_setup import make_setup
from sim.rendering.gl_context import GLUnavailable, choose_gl
from sim.rendering.panorama import PanoramaRenderer
from sim.scenario import Scenario
from sim.simulation.simulation import Simulation
from tests.benchmarks.throughput import per_frame
from tracker.datasets.validation import validate
from tracker.formats.summary import summarize
from tracker.geometry.cameras import Panorama
from tracker.io.atomic import write_text

FIGURES, PICTURE = (Path(__file__).with_name(f"growth.{ending}") for ending in ("json", "png"))
WIDTH, PEOPLE = 1024, 10
COLUMNS = 5
"""Plots in a row."""
SLEEP = 0.02
"""s that a stand-in for the drawing of one moment sleeps."""
POINTS: dict[str, tuple[int, ...]] = {
    "people": (1, 10, 50, 100, 200, 500),
    "cameras": (1, 2, 4, 8, 16, 32),
    "resolution": (512, 1024, 2048, 4096),
    "frames": (1_000, 10_000, 100_000),
    "landmarks": (50, 100, 200, 500, 1000, 2000),
    "workers": (1, 2, 4, 8, 16, 32, 64),
    "sequences": (100, 1_000, 10_000),
}
"""Measurement → sizes."""
DRAWN = ("people", "cameras", "resolution", "workers")
"""Measurements that choose an OpenGL backend."""


def memory() -> float:
    """Peak memory of this process, MiB."""
    return int(next(line for line in Path("/proc/self/status").read_text().splitlines() if line.startswith("VmHWM")).split()[1]) / 1024


def drawn(people: int, width: int, cameras: int = 4) -> dict[str, float]:
    """Processor time of a panorama with truth, ms, and of a step of a frame."""
    # Crowds of more than 100 do not fit into pilsun.
    simulation = Simulation(Scenario(people=people, world="pilsun" if people <= 100 else "campus"))
    robots = [simulation.T_world_robot(robot) @ simulation.mount(robot) for robot in simulation.robots]
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


def resident() -> float:
    """Memory of this process now, MiB."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 2**20


def simulated(frames: int) -> dict[str, float]:
    """Time and memory of frames without rendering, two rovers and four people. Memory is compared with that after a tenth of the frames."""
    scenario = Scenario(people=4, robots=2, frames=frames)
    simulation = Simulation(scenario)
    setup = make_setup(simulation)
    started, after, found = time.process_time(), frames // 10, np.zeros(0)
    for state in simulated_frames(simulation, setup):
        if state.index >= after and state.index % (frames // 100) == 0:
            found = np.append(found, resident())
    return {"ms a frame": 1e3 * (time.process_time() - started) / frames, "MiB more": float(found.max() - found[0])}


def mapped(landmarks: int) -> dict[str, float]:
    """Processor time of the filter for a frame of one robot and of four, ms."""
    return {"ms, one robot": per_frame(landmarks, 1), "ms, four robots": per_frame(landmarks, 4)}


def slept(part: Any) -> Any:
    """A part after the time of a sleep, in place of drawing."""
    time.sleep(SLEEP)
    return part


def scheduled(workers: int) -> dict[str, float]:
    """Moments a second through the queue of drawing workers, and their share of workers / SLEEP."""
    count = 40 * workers
    parts: Any = ([k] for k in range(count))
    with ThreadPoolExecutor(workers) as threads:
        started = time.perf_counter()
        assert list(drawn_in_order(parts, lambda part: threads.submit(slept, part), AHEAD * workers)) == list(range(count))
    rate = count / (time.perf_counter() - started)
    return {"moments a second": rate, "share of the best": rate * SLEEP / workers}


@cache
def one_sequence() -> Plan:
    """A dataset of one sequence of two frames, in a temporary folder that is removed at exit."""
    folder = tempfile.mkdtemp()
    atexit.register(shutil.rmtree, folder)
    preset = PRESETS["pilsun"]
    preset = replace(preset, scenario=replace(preset.scenario, frames=2, people=1, robots=1, width=64), views=0)
    plan = Plan("pilsun", preset, Path(folder, "one"), 1)
    generate(plan)
    return plan


def listed(sequences: int) -> dict[str, float]:
    """Seconds of the summary of a dataset of so many sequences, its check, and resuming it where all is there. The sequences are links to one."""
    one = one_sequence()
    with tempfile.TemporaryDirectory() as name:
        plan = replace(one, count=sequences, out=Path(name, "set"))
        for sequence in plan.dataset.sequences:
            shutil.copytree(one.out / one.dataset.sequences[0], plan.out / sequence, copy_function=os.link)
        write_text(plan.out / FILE, plan.dataset.to_json())
        # The links have the seed of the first sequence, so that each other one has a fault.
        done: dict[str, Callable[[], Any]] = {
            "resuming": lambda: generate(plan),
            "info": lambda: summarize(plan.out),
            "check": lambda: len(list(validate(plan.out))) == sequences - 1,
        }
        out = {}
        for what, action in done.items():
            started = time.process_time()
            assert action() is not False
            out[f"s of {what}"] = time.process_time() - started
        return out


MEASURE: dict[str, Callable[[int], dict[str, float]]] = {
    "people": lambda n: drawn(n, WIDTH),
    "cameras": lambda n: drawn(PEOPLE, WIDTH, n),
    "resolution": lambda n: drawn(PEOPLE, n, 1),
    "frames": simulated,
    "landmarks": mapped,
    "workers": scheduled,
    "sequences": listed,
}


def measured(name: str, size: int) -> dict[str, float]:
    """A measurement in a process that is forked from this one, with its peak memory. Raises what the measurement raises."""
    with get_context("fork").Pool(1) as pool:
        return pool.apply(_with_memory, (name, size))


def _with_memory(name: str, size: int) -> dict[str, float]:
    return MEASURE[name](size) | {"MiB": memory()}


def main(chosen: list[str] | None = None) -> None:
    """chosen: names of measurements; NAME=SIZE for one size."""
    os.environ |= dict.fromkeys(ONE_THREAD, "1")
    found: dict[str, dict[str, dict[str, float]]] = json.loads(FIGURES.read_text()) if FIGURES.exists() else {}
    for name, _, only in (one.partition("=") for one in chosen or MEASURE):
        if name in DRAWN:
            # The test of backends takes seconds; forked processes inherit its choice.
            choose_gl()
        if name == "sequences":
            one_sequence()
        for size in [int(only)] if only else POINTS[name]:
            try:
                values = measured(name, size)
            except (ValueError, OSError, GLUnavailable) as error:
                print(f"{name} {size}: {error}", flush=True)
                continue
            found.setdefault(name, {})[str(size)] = values
            print(f"{name:10} {size:7}   " + "   ".join(f"{what} {value:.4g}" for what, value in values.items()), flush=True)
            write_text(FIGURES, json.dumps(found, indent=1) + "\n")
    plot(found, PICTURE)


def plot(found: dict[str, dict[str, dict[str, float]]], path: Path) -> None:
    """One plot for each measurement and unit, against the size. The times of datasets have logarithmic axes."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    cells = [(name, points, what) for name, points in found.items() for what in next(iter(points.values()))]
    figure, axes = plt.subplots(-(-len(cells) // COLUMNS), COLUMNS, figsize=(2.9 * COLUMNS, 2.1 * -(-len(cells) // COLUMNS)), layout="constrained")
    for axis in axes.flat[len(cells) :]:
        axis.set_visible(False)
    for axis, (name, points, what) in zip(axes.flat, cells, strict=False):
        sizes = sorted(map(int, points))
        axis.plot(sizes, [points[str(size)][what] for size in sizes], marker="o", markersize=4)
        if what.startswith("s of"):
            axis.set(xscale="log", yscale="log")
        else:
            axis.set(xscale="log", ylim=(0, None))
        axis.set_xticks(sizes, [f"{size:g}" if size < 1e5 else f"{size:.0e}" for size in sizes])
        axis.minorticks_off()
        axis.set_title(what, fontsize=9)
        axis.set_xlabel(name, fontsize=8)
        axis.tick_params(labelsize=6)
        axis.grid(alpha=0.3)
    figure.savefig(path, dpi=75)


if __name__ == "__main__":
    main(sys.argv[1:])
