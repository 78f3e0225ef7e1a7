"""Speed of the tracker of people against people, views, K_H and i_bls^max, and the gap of its cliques from the optimum.

The data are seeded crowds among fixed panoramas (tracker/datasets/synthetic_crowd.py), with misses 0.1 and 0.05 false boxes per view and frame. The
table shows processor time of one core per frame, ms. A number sets the frames of each run: `python -m tests.benchmarks.tracker 10`.
"""

from __future__ import annotations

import importlib.util
import itertools
import sys
import tempfile
import time
from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from tests.conftest import DATA
from tracker.clique.dimacs import read_graph
from tracker.clique.exact_clique import exact
from tracker.clique.local_search import Graph
from tracker.datasets import synthetic_crowd
from tracker.formats.opening import open_sequence
from tracker.formats.source_options import SourceOptions
from tracker.pipeline import Parameters, track
from tracker.tracks.parameters import MhtParameters
from tracker.types import Setup, Tick

FRAMES = 24
PEOPLE = (10, 25, 50, 74, 100)
VIEWS = (1, 3, 5, 7)
K_H = (1, 10, 30)
MOVES = (500, 2000)
PROOF_LIMIT = 5.0
"""Time limit of a proof, s. Graphs without a proof are counted."""
MAX_GRAPHS = 8
"""Largest number of graphs of a run that are solved exactly, evenly spread over it."""


def per_frame(people: int, views: int, parameters: Parameters, frames: int) -> float:
    """Processor time per frame of a synthetic crowd, ms."""
    rng = np.random.default_rng([people, views])
    setup, walks = synthetic_crowd.setup(views), synthetic_crowd.paths(people, frames, rng)
    return spent(setup, synthetic_crowd.ticks(setup, walks, rng), parameters)


def spent(setup: Setup, ticks: Iterable[Tick], parameters: Parameters) -> float:
    """Processor time per frame, ms."""
    began = time.process_time()
    frames = len(list(track(setup, ticks, parameters)))
    return 1000 * (time.process_time() - began) / frames


def gaps(people: int, frames: int, parameters: MhtParameters) -> Iterator[tuple[float, float, float]]:
    """For graphs of a run: gap of the weight as a share of the optimum, time of our proof, s, and time of CP-SAT, s; NaN without a proof."""
    rng = np.random.default_rng(0)
    setup, walks = synthetic_crowd.setup(), synthetic_crowd.paths(people, frames, rng)
    with tempfile.TemporaryDirectory() as folder:
        list(track(setup, synthetic_crowd.ticks(setup, walks, rng, clutter=1.0), Parameters(targets=parameters, graphs=Path(folder))))
        paths = sorted(Path(folder).glob("*.clq"))
        for k in np.unique(np.linspace(0, len(paths) - 1, min(MAX_GRAPHS, len(paths))).round().astype(int)).tolist():
            graph = read_graph(paths[k])
            chosen = np.array(paths[k].with_suffix(".txt").read_text().split(), dtype=np.int64) - 1
            assert graph.is_clique(chosen), paths[k]
            ours, ours_seconds = by_ours(graph)
            theirs, their_seconds = by_cpsat(graph)
            assert not abs(ours - theirs) > 1e-3, paths[k]
            best = ours if np.isfinite(ours) else theirs
            yield 1 - float(graph.weight[chosen].sum()) / best, ours_seconds, their_seconds


def by_ours(graph: Graph) -> tuple[float, float]:
    """The proved weight, and the time, s."""
    try:
        proof = exact(graph, PROOF_LIMIT)
    except ValueError:
        return float("nan"), float("nan")
    return proof.weight, proof.seconds


def by_cpsat(graph: Graph) -> tuple[float, float]:
    """The weight that CP-SAT proves, to a millionth, and its time, s."""
    if importlib.util.find_spec("ortools") is None:
        return float("nan"), float("nan")
    from ortools.sat.python import cp_model

    model = cp_model.CpModel()
    inside = [model.new_bool_var(f"v{v}") for v in range(len(graph))]
    rows = np.repeat(np.arange(len(graph)), np.diff(graph.start))
    for a, b in zip(rows.tolist(), graph.conflict.tolist(), strict=True):
        if a < b:
            model.add_at_most_one([inside[a], inside[b]])
    model.maximize(sum(round(1e6 * float(w)) * x for w, x in zip(graph.weight, inside, strict=True)))
    solver = cp_model.CpSolver()
    solver.parameters.num_workers, solver.parameters.max_time_in_seconds = 1, PROOF_LIMIT
    began = time.perf_counter()
    proved = solver.solve(model) == cp_model.OPTIMAL
    return (solver.objective_value / 1e6, time.perf_counter() - began) if proved else (float("nan"), float("nan"))


def main() -> None:
    """Print the tables."""
    frames = int(sys.argv[1]) if sys.argv[1:] and sys.argv[1].isdecimal() else FRAMES
    greedy, usual, small = Parameters(targets=MhtParameters(n_scan=0.0)), Parameters(), MhtParameters(k_h=25)
    for warm in (greedy, usual, Parameters(targets=small)):
        per_frame(3, 1, warm, 5)
    print(f"tracker, ms per frame, {frames} frames, one core: greedy / default")
    print(f"{'people':>8}" + "".join(f"{f'{v} views':>20}" for v in VIEWS))
    for people in PEOPLE:
        cells = [f"{per_frame(people, v, greedy, frames):8.1f} /{per_frame(people, v, usual, frames):8.1f}" for v in VIEWS]
        print(f"{people:>8}" + "".join(f"{cell:>20}" for cell in cells), flush=True)
    if (DATA / "pets2009").is_dir():
        sequence = open_sequence(DATA / "pets2009" / "S2.L1", SourceOptions(("1", "5", "7")))
        ticks = list(itertools.islice(iter(sequence.ticks), 10 * frames))
        print("\nPETS 2009 S2.L1, views 1, 5, 7: " + " / ".join(f"{spent(sequence.setup, ticks, p):.1f}" for p in (greedy, usual)), flush=True)
    print("\nK_H and i_bls^max, a graph for each hypothesis, 30 people, 3 views")
    print(f"{'K_H':>8}" + "".join(f"{f'i_max {m}':>12}" for m in MOVES))
    for k in K_H:
        cells = [f"{per_frame(30, 3, Parameters(targets=replace(small, k_h=k, i_bls_max=m)), frames):.1f}" for m in MOVES]
        print(f"{k:>8}" + "".join(f"{cell:>12}" for cell in cells), flush=True)
    print(f"\ngaps of the clique search (3 views, 1 false box per view and frame, at most {PROOF_LIMIT:g} s for a proof)")
    for people, name, parameters in (
        (20, "one graph", MhtParameters()),
        (43, "one graph", MhtParameters()),
        (74, "one graph", MhtParameters()),
        (20, "small graphs, K_H 5", MhtParameters(k_h=5)),
    ):
        print(f"{people} people, {name}: {gap_text(np.array(list(gaps(people, frames, parameters))).reshape(-1, 3))}", flush=True)


def gap_text(found: np.ndarray) -> str:
    """The result of `gaps` in words."""
    proved = found[np.isfinite(found[:, 0])]
    if not len(proved):
        return f"{len(found)} graphs, none proved"
    taken = [column[np.isfinite(column)] for column in found.T[1:]]
    seconds = ", ".join(f"{who} {len(t)} in {t.mean():.4f} s each" for who, t in zip(("our proof", "CP-SAT"), taken, strict=True) if len(t))
    gap = np.maximum(proved[:, 0], 0)
    return f"{len(found)} graphs, {len(proved)} proved, of these {np.mean(gap < 1e-6):.2%} optimal, mean gap {gap.mean():.4%}; {seconds}"


if __name__ == "__main__":
    main()
