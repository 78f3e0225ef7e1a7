"""The tracker of people: milliseconds a frame against people, views, K_H and i_bls^max; and how far its cliques are from the best.

Seeded crowds among fixed panoramas (tracker/crowds.py), misses 0.1, 0.05 false boxes a view and frame; processor time of one core.
"""

from __future__ import annotations

import importlib.util
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from tracker import crowds
from tracker.clique import Graph
from tracker.exact_clique import exact
from tracker.formats.dimacs import read_graph
from tracker.pipeline import Parameters, track
from tracker.selection import MultipleParameters

FRAMES = 40
PEOPLE = (10, 25, 50, 74, 100)
VIEWS = (1, 3, 5, 7)
K_H = (1, 10, 30)
MOVES = (500, 2000)


def per_frame(people: int, views: int, parameters: Parameters) -> float:
    """Milliseconds of processor time."""
    rng = np.random.default_rng([people, views])
    setup, walked = crowds.setup(views), crowds.paths(people, FRAMES, rng)
    ticks = crowds.ticks(setup, walked, rng)
    began = time.process_time()
    list(track(setup, ticks, parameters))
    return 1000 * (time.process_time() - began) / FRAMES


def gaps(parameters: MultipleParameters) -> Iterator[tuple[float, float, float]]:
    """For each graph of a run: share of the best weight that is missing, seconds of our proof, seconds of CP-SAT or NaN."""
    rng = np.random.default_rng(0)
    setup, walked = crowds.setup(), crowds.paths(20, FRAMES, rng)
    with tempfile.TemporaryDirectory() as folder:
        asked = MultipleParameters(**{**parameters.__dict__, "graphs": Path(folder)})
        list(track(setup, crowds.ticks(setup, walked, rng, clutter=1.0), Parameters(multiple=asked)))
        for path in sorted(Path(folder).glob("*.clq")):
            graph = read_graph(path)
            chosen = np.array(path.with_suffix(".txt").read_text().split(), dtype=np.int64) - 1
            assert graph.is_clique(chosen), path
            proof = exact(graph)
            yield 1 - float(graph.weight[chosen].sum()) / proof.weight, proof.seconds, by_cpsat(graph, proof.weight)


def by_cpsat(graph: Graph, weight: float) -> float:
    """Seconds of CP-SAT to the optimum, proved; weights to a millionth."""
    if importlib.util.find_spec("ortools") is None:
        return float("nan")
    from ortools.sat.python import cp_model

    model = cp_model.CpModel()
    inside = [model.new_bool_var(f"v{v}") for v in range(len(graph))]
    rows = np.repeat(np.arange(len(graph)), np.diff(graph.start))
    for a, b in zip(rows.tolist(), graph.conflict.tolist(), strict=True):
        if a < b:
            model.add_at_most_one([inside[a], inside[b]])
    model.maximize(sum(round(1e6 * float(w)) * x for w, x in zip(graph.weight, inside, strict=True)))
    solver = cp_model.CpSolver()
    solver.parameters.num_workers = 1
    began = time.perf_counter()
    solver.solve(model)
    assert abs(solver.objective_value / 1e6 - weight) < 1e-3 * max(1.0, weight)
    return time.perf_counter() - began


def main() -> None:
    """Print the tables."""
    single = Parameters()
    many = Parameters(multiple=MultipleParameters())
    for warm in (single, many, Parameters(multiple=MultipleParameters(small_graphs=True))):
        per_frame(3, 1, warm)
    print(f"tracker, ms a frame, {FRAMES} frames, one core: one hypothesis / track trees")
    print(f"{'people':>8}" + "".join(f"{f'{v} views':>20}" for v in VIEWS))
    for people in PEOPLE:
        cells = [f"{per_frame(people, v, single):8.1f} /{per_frame(people, v, many):8.1f}" for v in VIEWS]
        print(f"{people:>8}" + "".join(f"{cell:>20}" for cell in cells), flush=True)
    print("\nK_H and i_bls^max, a graph for each hypothesis, 30 people, 3 views")
    print(f"{'K_H':>8}" + "".join(f"{f'i_max {m}':>12}" for m in MOVES))
    for k in K_H:
        cells = [per_frame(30, 3, Parameters(multiple=MultipleParameters(k_h=k, i_bls_max=m, small_graphs=True))) for m in MOVES]
        print(f"{k:>8}" + "".join(f"{cell:>12.1f}" for cell in cells), flush=True)
    print("\nthe graphs beside their proved optimum (20 people, 3 views, 1 false box a view and frame)")
    for name, parameters in (("one graph", MultipleParameters()), ("small graphs, K_H 5", MultipleParameters(small_graphs=True, k_h=5))):
        found = np.array(list(gaps(parameters))).reshape(-1, 3)
        if len(found):
            best, gap = float((found[:, 0] < 1e-9).mean()), float(found[:, 0].mean())
            seconds = f"proof {found[:, 1].mean():.4f} s, CP-SAT {found[:, 2].mean():.4f} s"
            print(f"{name}: {len(found)} graphs, {best:.2%} optimal, mean gap {gap:.4%}, {seconds}")


if __name__ == "__main__":
    main()
