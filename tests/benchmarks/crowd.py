"""Crowd steps per second compared with jupedsim (SocialForce, CollisionFreeSpeed) and pysocialforce: `python -m tests.benchmarks.crowd`.

All models simulate one scene: dt 0.05 s, four obstacles of 0.25 m, and a square with 0.5 people per m². People walk to four goals in turn.
Process time is measured, which other work on the machine affects little. The peers must be installed:
pip install --no-deps jupedsim pysocialforce shapely deprecated wrapt toml.
"""

from __future__ import annotations

import contextlib
import importlib.util
import logging
import statistics
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from sim.crowd.crowd import Crowd, Obstacles
from sim.crowd.goals import GoalPlans
from tracker.geometry import Array
from worlds.terrain.free_space import FEET, free_space
from worlds.terrain.heightfield import Heightfield

DT, DENSITY, RADIUS, APART = 0.05, 0.5, 0.25, 0.7
SIZES = (10, 74, 500, 2000)
REPETITIONS, WARM_UP = 7, 5
SLOW = 500
"""Largest number of people for pysocialforce, which compares all pairs of people in Python."""


@dataclass(frozen=True)
class Scene:
    """side of the square, m; people (n, 2) m; obstacles (4, 2) m; goals (4, 2) m; goal (n,): the first goal of each person."""

    side: float
    people: Array
    obstacles: Array
    goals: Array
    goal: Array

    @staticmethod
    def of(n: int) -> Scene:
        side = float(np.sqrt(n / DENSITY))
        corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
        obstacles, goals = side * (0.3 + 0.4 * corners), side * 0.5 + (side * 0.5 - 0.8) * (2.0 * corners - 1)
        columns = int(side / 0.25)
        x = (np.arange(columns) + 0.5) * side / columns
        places = np.stack(np.meshgrid(x, x), axis=-1).reshape(-1, 2)
        free = np.linalg.norm(places[:, None] - obstacles, axis=2).min(axis=1) > RADIUS + 0.35
        inside = np.abs(places - side / 2).max(axis=1) < side / 2 - 0.4
        # With closer starts, jupedsim pushes people out of its area.
        places, chosen = np.random.default_rng(n).permutation(places[free & inside]), []
        while len(chosen) < n:
            chosen.append(places[0])
            places = places[np.hypot(*(places - places[0]).T) > APART]
        people = np.array(chosen)
        return Scene(side, people, obstacles, goals, np.linalg.norm(people[:, None] - goals, axis=2).argmin(axis=1))


def ours(scene: Scene) -> Callable[[int], None]:
    """A function that makes a number of steps of our crowd."""
    ground = Heightfield.flat([[-0.6, -0.6], [scene.side + 0.6, scene.side + 0.6]], 0.2)
    feet = free_space(ground, np.zeros(ground.heights.shape, dtype=bool), FEET)
    n = len(scene.people)
    itinerary = (scene.goal[:, None] + np.arange(4)) % 4
    crowd = Crowd(feet, ground, GoalPlans.of(np.full(n, 1.2), scene.goals, itinerary, np.full((n, 4), 0.1)))
    state = [crowd.start(scene.people, np.zeros(n))]
    obstacles = Obstacles(scene.obstacles, np.zeros((4, 2)), np.full(4, RADIUS))

    def run(steps: int) -> None:
        for _ in range(steps):
            state[0] = crowd.step(state[0], obstacles, DT)

    return run


def jupedsim(scene: Scene, name: str) -> Callable[[int], None]:
    """As `ours`, with a model of jupedsim by its name. Obstacles are octagons."""
    import jupedsim as jps
    from shapely.geometry import Point, box

    area = box(0, 0, scene.side, scene.side)
    for x, y in scene.obstacles:
        area = area.difference(Point(x, y).buffer(RADIUS, quad_segs=2))
    simulation = jps.Simulation(model=getattr(jps, f"{name}Model")(), geometry=area, dt=DT)
    stages = [simulation.add_waypoint_stage(tuple(goal), 0.7) for goal in scene.goals]
    journey = jps.JourneyDescription(stages)
    for k, stage in enumerate(stages):
        journey.set_transition_for_stage(stage, jps.Transition.create_fixed_transition(stages[(k + 1) % 4]))
    number = simulation.add_journey(journey)
    parameters = getattr(jps, f"{name}ModelAgentParameters")
    for place, goal in zip(scene.people, scene.goal, strict=True):
        simulation.add_agent(parameters(position=tuple(place), journey_id=number, stage_id=stages[goal]))

    def run(steps: int) -> None:
        simulation.iterate(steps)
        assert simulation.agent_count() == len(scene.people)

    return run


def pysocialforce(scene: Scene) -> Callable[[int], None]:
    """As `ours`, with pysocialforce. Obstacles are squares of lines."""
    logging.disable(logging.INFO)
    # The import of pysocialforce opens a log file in the working directory.
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        import pysocialforce

    n = len(scene.people)
    state = np.column_stack([scene.people, np.zeros((n, 2)), scene.goals[scene.goal.astype(int)]])
    lines = []
    for x, y in scene.obstacles:
        west, east, south, north = x - RADIUS, x + RADIUS, y - RADIUS, y + RADIUS
        lines += [[west, east, south, south], [west, east, north, north], [west, west, south, north], [east, east, south, north]]
    return pysocialforce.Simulator(state, obstacles=lines).step


def microseconds(run: Callable[[int], None], steps: int) -> float:
    """Median process time of a step, µs."""
    run(WARM_UP)
    taken = []
    for _ in range(REPETITIONS):
        start = time.process_time()
        run(steps)
        taken.append((time.process_time() - start) / steps * 1e6)
    return statistics.median(taken)


def measure(sizes: tuple[int, ...] = SIZES) -> list[dict[str, float]]:
    """A row for each number of people: µs per step of each model, NaN where it did not run."""
    rows = []
    for n in sizes:
        scene, steps = Scene.of(n), max(5, 6000 // n)
        row = {"people": float(n), "ours": microseconds(ours(scene), steps)}
        for name in ("SocialForce", "CollisionFreeSpeed"):
            row[name] = microseconds(jupedsim(scene, name), steps) if importlib.util.find_spec("jupedsim") else np.nan
        compared = n <= SLOW and importlib.util.find_spec("pysocialforce")
        row["pysocialforce"] = microseconds(pysocialforce(scene), max(2, steps // 20)) if compared else np.nan
        rows.append(row)
    return rows


def main() -> None:
    rows = measure()
    names = ("SocialForce", "CollisionFreeSpeed", "pysocialforce")
    for module in ("jupedsim", "pysocialforce"):
        if not importlib.util.find_spec(module):
            print(f"{module} is not installed: its columns are empty")
    print(f"{'people':>6} {'ours, steps/s':>14}" + "".join(f"{name + ' steps/s (ours ×)':>38}" for name in names))
    for row in rows:
        peers = "".join(f"{1e6 / row[name]:>27.0f} ({row[name] / row['ours']:>7.2f})" for name in names)
        print(f"{row['people']:>6.0f} {1e6 / row['ours']:>14.0f}" + peers)
    cost = {row["people"]: row["ours"] for row in rows}
    print(f"cost of a step, 2000 people over 500: {cost[2000] / cost[500]:.2f}")


if __name__ == "__main__":
    main()
