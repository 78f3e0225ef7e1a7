"""The best set of tracks: a maximum-weight clique of leaves that may be true together.

The graphs that a run of the tracker by multiple hypotheses solves, written down: so that another solver can be asked, too.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numba import njit

from tracker.clique.clique_cover import labels
from tracker.clique.local_search import Graph, Limits, Options, Tuning, search
from tracker.clique.set_packing import Effort, settled
from tracker.formats.dimacs import write_graph
from tracker.geometry import Array, Ints, Mask
from tracker.mht.conflicts import Conflicts
from tracker.mht.parameters import MhtParameters
from tracker.mht.track_trees import TrackHypotheses, weights


@dataclass(frozen=True, eq=False)
class GlobalHypothesis:
    """best: rows of the leaves in the best hypothesis; hypotheses (k, n): which leaves each holds that is kept, the best first, at most K_H;
    conflict (n, n): which leaves exclude each other."""

    best: Ints
    hypotheses: Mask
    conflict: Mask


def solve(leaves: TrackHypotheses, bonds: Conflicts, previous: Mask, parameters: MhtParameters, seed: int) -> GlobalHypothesis:
    """Which leaves are true; previous (k, n): for each hypothesis of the tick before, which leaves are children of its leaves."""
    q = parameters
    weight = weights(leaves, q.most_weight)
    usable = (weight > 0) & (leaves.score > 0)
    one = np.where(leaves.believed[:, None] & leaves.believed[None, :], q.duplicate, q.duplicate / 2)
    conflict = bonds.conflict | (bonds.together > one)
    np.fill_diagonal(conflict, False)
    graph = Graph.from_rows(weight, np.count_nonzero(conflict, axis=1), np.flatnonzero(conflict) % max(len(weight), 1))
    if not q.small_graphs or not len(previous):
        start = previous[0] if len(previous) else np.zeros(len(leaves), dtype=bool)
        found = _optima(Problem(graph, start, seed), np.flatnonzero(usable), replace(q, k_h=1), {})
    else:
        young = usable & ~leaves.believed
        sets: dict[bytes, Mask] = {}
        solved: Solved = {}
        for k, children in enumerate(previous):
            for held in _optima(Problem(graph, children, seed + 1000 * k), np.flatnonzero(young | (usable & children)), q, solved):
                sets.setdefault(held.tobytes(), held)
        found = np.array(sorted(sets.values(), key=lambda held: -weight[held].sum())[: q.k_h])
    return GlobalHypothesis(np.flatnonzero(found[0]), found, conflict)


Solved = dict[bytes, tuple[Array, Mask]]
"""Weights (k,) of the optima of a part, and which of its rows each holds (k, rows); by the rows and where the search began."""


@dataclass(frozen=True, eq=False)
class Problem:
    """graph of all leaves, also of those that weigh nothing and are never chosen; start (n,): where to begin; seed of the search."""

    graph: Graph
    start: Mask
    seed: int


def _moves(graph: Graph, q: MhtParameters) -> int:
    return min(max(10 * graph.edges, 200), q.i_bls_max)


def warm_start(graph: Graph, start: Mask) -> Ints:
    """Vertices to begin with: the heaviest of `start` (n,) that go together, then the heaviest of the others that do."""
    out: Ints = _together(graph.start, graph.conflict, np.lexsort((-graph.weight, ~start)))
    return out


@njit(cache=True)
def _together(start: Ints, conflict: Ints, order: Ints) -> Ints:
    """Vertices in this order, without those in conflict with one before that is not left out."""
    free, out, n = np.ones(len(order), np.bool_), np.empty(len(order), np.int64), 0
    for v in order:
        if free[v]:
            out[n] = v
            n += 1
            free[conflict[start[v] : start[v + 1]]] = False
    return out[:n].copy()


def _optima(p: Problem, rows: Ints, q: MhtParameters, solved: Solved) -> Mask:
    """The heaviest sets (k, n) of `rows`, at most K_H: the local optima of each part in all combinations, as what is chosen in one connected part
    of the conflicts says nothing of another. A part that another hypothesis has, too, is `solved`."""
    label = labels(p.graph.start, p.graph.conflict, rows)
    order = np.argsort(label, kind="stable")
    ends = np.flatnonzero(np.diff(label[order], append=-1)) + 1
    total, out = np.zeros(1), np.zeros((1, len(p.graph)), dtype=bool)
    for first, end in itertools.pairwise([0, *ends.tolist()]):
        part = rows[order[first:end]]
        key = part.tobytes() + (p.start[part].tobytes() if q.warm else b"")
        if key not in solved:
            solved[key] = _of_part(p, part, q)
        weight, held = solved[key]
        sums = (total[:, None] + weight).ravel()
        best = np.argsort(-sums, kind="stable")[: q.k_h]
        total, out = sums[best], out[best // len(weight)]
        out[:, part] = held[best % len(weight)]
    return out


def _of_part(p: Problem, part: Ints, q: MhtParameters) -> tuple[Array, Mask]:
    """The local optima of one search in a part, at most K_H, the best first, which is proved or mended; weights (k,), and (k, rows) as in Solved."""
    graph = p.graph.within(part)
    if not graph.edges:
        order = np.argsort(-graph.weight, kind="stable")[: q.k_h]
        return graph.weight[order], np.arange(len(part)) == order[:, None]
    start = warm_start(graph, p.start[part]) if q.warm else None
    if q.mended and q.k_h == 1:
        best, _ = settled(graph, np.zeros(0, dtype=np.int64) if start is None else start, Effort(_moves(graph, q), p.seed, q.branches))
        optima = [best]
    else:
        found = search(graph, Limits(moves=_moves(graph, q)), p.seed, Options(keep=q.k_h, start=start, tuning=Tuning(T=10)))
        optima = [best for _, best in found.optima] or [found.vertices]
        better = settled(graph, optima[0], Effort(0, p.seed, q.branches))[0] if q.mended else optima[0]
        if graph.weight[better].sum() > graph.weight[optima[0]].sum() + 1e-9:
            optima = [better, *optima][: q.k_h]
    if q.graphs is not None:
        dump(q.graphs, f"{p.seed:08d}-{part.min()}", graph, optima[0])
    held = np.zeros((len(optima), len(part)), dtype=bool)
    for row, rows in zip(held, optima, strict=True):
        row[rows] = True
    return np.array([graph.weight[rows].sum() for rows in optima]), held


def dump(folder: Path, name: str, graph: Graph, chosen: Ints) -> None:
    """Write `graph` as folder/NAME.clq (DIMACS, weighted) and the clique that was chosen, vertices from 1 in a row, as folder/NAME.txt."""
    folder.mkdir(parents=True, exist_ok=True)
    write_graph(folder / f"{name}.clq", graph)
    (folder / f"{name}.txt").write_text(" ".join(str(v + 1) for v in chosen.tolist()) + "\n", encoding="utf-8")
