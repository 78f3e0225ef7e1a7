"""The clique search compared with its peers: the exact search of networkx, CP-SAT on the complement, and a plain tabu search.

The table shows the time to the best known weight on the graphs of `clique/` in the real data. Ours runs with 10 seeds; the limit is 10 s each.
"""

from __future__ import annotations

import csv
import importlib.util
import os
import signal
import time
from pathlib import Path

import numpy as np

from tests.conftest import DATA
from tracker.clique.dimacs import read_graph
from tracker.clique.exact_clique import exact
from tracker.clique.local_search import Graph, Limits, search

LIMIT = float(os.environ.get("PILSIM_CLIQUE_SECONDS", "10"))
SEEDS = 10


def ours(graph: Graph, target: float) -> tuple[str, str]:
    """The share of seeds that reach the target, and their median time, s."""
    found = [search(graph, Limits(seconds=LIMIT, target=target), seed) for seed in range(SEEDS)]
    reached = [f.seconds for f in found if f.weight >= target]
    return f"{len(reached)}/{SEEDS}", f"{np.median(reached):.3f}" if reached else f"({max(f.weight for f in found):g})"


def proved(graph: Graph) -> str:
    try:
        return f"{exact(graph, LIMIT).seconds:.3f}"
    except ValueError:
        return "–"


def by_networkx(graph: Graph, target: float) -> str:
    import networkx

    weights = graph.weight.astype(int)
    conflicts = set(pairs(graph))
    peer = networkx.Graph((a, b) for b in range(len(graph)) for a in range(b) if (a, b) not in conflicts)
    peer.add_nodes_from((v, {"weight": int(w)}) for v, w in enumerate(weights))

    def stop(*_: object) -> None:
        raise TimeoutError

    signal.signal(signal.SIGALRM, stop)
    signal.setitimer(signal.ITIMER_REAL, LIMIT)
    start = time.perf_counter()
    try:
        _, weight = networkx.max_weight_clique(peer)
        return f"{time.perf_counter() - start:.3f}" if weight >= target else f"({weight})"
    except TimeoutError:
        return "–"
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)


def by_cpsat(graph: Graph, target: float) -> str:
    from ortools.sat.python import cp_model

    model = cp_model.CpModel()
    inside = [model.new_bool_var(f"v{v}") for v in range(len(graph))]
    for a, b in pairs(graph):
        model.add_at_most_one([inside[a], inside[b]])
    model.maximize(sum(int(w) * x for w, x in zip(graph.weight, inside, strict=True)))
    solver = cp_model.CpSolver()
    solver.parameters.max_time_in_seconds, solver.parameters.num_workers = LIMIT, 1

    class Watch(cp_model.CpSolverSolutionCallback):
        def on_solution_callback(self) -> None:
            if self.objective_value >= target:
                self.stop_search()

    start = time.perf_counter()
    solver.solve(model, Watch())
    spent = time.perf_counter() - start
    return f"{spent:.3f}" if solver.objective_value >= target else f"({solver.objective_value:g})"


def by_tabu(graph: Graph, target: float, seed: int = 0) -> str:
    """Tabu search in plain numpy: the best of add, swap and drop that is not tabu. Dropped vertices are tabu for about ten moves."""
    rng, n = np.random.default_rng(seed), len(graph)
    conflicts = np.zeros((n, n), dtype=bool)
    conflicts[np.repeat(np.arange(n), np.diff(graph.start)), graph.conflict] = True
    inside, tabu, best, move = np.zeros(n, dtype=bool), np.zeros(n, dtype=int), 0.0, 0
    start = time.perf_counter()
    while time.perf_counter() - start < LIMIT:
        blocks, load = conflicts[:, inside].sum(axis=1), conflicts[:, inside] @ graph.weight[inside]
        gain = np.where(inside, -graph.weight, np.where(blocks <= 1, graph.weight - load, -np.inf))
        gain[~inside & (tabu > move)] = -np.inf
        v = int(rng.choice(np.flatnonzero(gain == gain.max())))
        out = np.flatnonzero(inside & conflicts[v]) if not inside[v] else np.array([v])
        tabu[out] = move + 7 + rng.integers(1 + (blocks == 1).sum(), size=len(out))
        inside[v], inside[out] = not inside[v], False
        move += 1
        best = max(best, float(graph.weight[inside].sum()))
        if best >= target:
            return f"{time.perf_counter() - start:.3f}"
    return f"({best:g})"


def pairs(graph: Graph) -> list[tuple[int, int]]:
    rows = np.repeat(np.arange(len(graph)), np.diff(graph.start))
    return [(int(a), int(b)) for a, b in zip(rows, graph.conflict, strict=True) if a < b]


def main() -> None:
    """Print the table: seconds to the best known weight, or the best weight found in brackets, or – without a result."""
    if not (DATA / "clique").is_dir():
        print(f"cliques: {DATA / 'clique'} is not there (PILSIM_DATA): skipped")
        return
    peers = {"networkx": by_networkx, "CP-SAT": by_cpsat, "tabu": by_tabu}
    modules = {"networkx": "networkx", "CP-SAT": "ortools", "tabu": "numpy"}
    used = {name: solve for name, solve in peers.items() if importlib.util.find_spec(modules[name])}
    with (DATA / "clique" / "optima.csv").open() as file:
        best = {row["instance"]: float(row["weighted_imod200p1"]) for row in csv.DictReader(file)}
    search(Graph.from_conflicts([1.0, 2.0], [[0, 1]]), Limits(moves=10))
    exact(Graph.from_conflicts([1.0, 2.0], [[0, 1]]))
    print(f"cliques, seconds to the best known weight, limit {LIMIT:g} s, one thread")
    print(f"{'graph':16}{'weight':>7}{'seeds':>7}" + "".join(f"{name:>11}" for name in ("ours", "our proof", *used)))
    for name, target in best.items():
        graph = read_graph(Path(DATA) / "clique" / f"{name}.clq")
        seeds, seconds = ours(graph, target)
        cells = [seconds, proved(graph), *(solve(graph, target) for solve in used.values())]
        print(f"{name:16}{target:>7g}{seeds:>7}" + "".join(f"{cell:>11}" for cell in cells), flush=True)


if __name__ == "__main__":
    main()
