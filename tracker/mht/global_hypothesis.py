"""The global hypothesis: the maximum-weight clique of leaves that may be true together (Reid 1979; Kim et al. 2015, section 3.4).

The graphs can be written as files, so that other solvers can be compared.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from tracker.clique.clique_cover import component_labels
from tracker.clique.local_search import Graph, Limits, Options, Tuning, search
from tracker.clique.set_packing import Effort, heaviest_clique
from tracker.formats.dimacs import write_graph
from tracker.geometry import Array, Ints, Mask
from tracker.geometry.compilation import njit
from tracker.mht.conflicts import Conflicts
from tracker.mht.parameters import MhtParameters
from tracker.mht.track_trees import TrackHypotheses, weights


@dataclass(frozen=True, eq=False)
class GlobalHypothesis:
    """best: rows of the leaves in the global hypothesis; conflict (n, n): which leaves exclude each other.

    hypotheses (k, n): the leaves of each hypothesis that is kept, the best first, at most K_H.
    """

    best: Ints
    hypotheses: Mask
    conflict: Mask


@dataclass(frozen=True, eq=False)
class Problem:
    """graph of all leaves; start (n,): vertices from which the search starts; seed of the search."""

    graph: Graph
    start: Mask
    seed: int


Solved = dict[bytes, tuple[Array, Mask]]
"""By the rows and the start of a component: weights (k,) of its optima, and which of its rows (k, rows) each holds."""


def solve(leaves: TrackHypotheses, conflicts: Conflicts, previous: Mask, parameters: MhtParameters, seed: int) -> GlobalHypothesis:
    """The global hypothesis; previous (k, n): for each hypothesis of the last tick, which leaves are children of its leaves."""
    q = parameters
    weight = weights(leaves, q.max_weight)
    # A leaf that is too fast is not kept. If it were chosen here, its tree would lose the leaves that agree with the others.
    usable = (weight > 0) & (leaves.score > 0) & (leaves.speed <= q.motion.v_max)
    merge_score = np.where(leaves.confirmed[:, None] & leaves.confirmed[None, :], q.merge_score, q.merge_score / 2)
    conflict = conflicts.conflict | (conflicts.same_person > merge_score)
    np.fill_diagonal(conflict, False)
    # Leaves that are not usable stay in the graph, but are never chosen.
    graph = Graph.from_rows(weight, np.count_nonzero(conflict, axis=1), np.flatnonzero(conflict) % max(len(weight), 1))
    if not q.small_graphs or not len(previous):
        start = previous[0] if len(previous) else np.zeros(len(leaves), dtype=bool)
        found = _optima(Problem(graph, start, seed), np.flatnonzero(usable), replace(q, k_h=1), {})
    else:
        tentative = usable & ~leaves.confirmed
        sets: dict[bytes, Mask] = {}
        solved: Solved = {}
        for k, children in enumerate(previous):
            for held in _optima(Problem(graph, children, seed + 1000 * k), np.flatnonzero(tentative | (usable & children)), q, solved):
                sets.setdefault(held.tobytes(), held)
        found = np.array(sorted(sets.values(), key=lambda held: -weight[held].sum())[: q.k_h])
    return GlobalHypothesis(np.flatnonzero(found[0]), found, conflict)


def warm_start(graph: Graph, start: Mask) -> Ints:
    """A clique to start from: the heaviest vertices of `start` (n,) first, then the others, each where no chosen one excludes it."""
    out: Ints = _greedy_clique(graph.start, graph.conflict, np.lexsort((-graph.weight, ~start)))
    return out


def dump(folder: Path, name: str, graph: Graph, chosen: Ints) -> None:
    """Write `graph` as folder/NAME.clq (DIMACS, weighted), and the vertices of the chosen clique, counted from 1, as folder/NAME.txt."""
    folder.mkdir(parents=True, exist_ok=True)
    write_graph(folder / f"{name}.clq", graph)
    (folder / f"{name}.txt").write_text(" ".join(str(v + 1) for v in chosen.tolist()) + "\n", encoding="utf-8")


def _optima(p: Problem, rows: Ints, q: MhtParameters, solved: Solved) -> Mask:
    """The heaviest cliques (k, n) among `rows`, at most K_H.

    Connected components of the conflicts are independent: their local optima are combined in all ways. A component in `solved` is not solved again.
    """
    label = component_labels(p.graph.start, p.graph.conflict, rows)
    order = np.argsort(label, kind="stable")
    ends = np.flatnonzero(np.diff(label[order], append=-1)) + 1
    total, out = np.zeros(1), np.zeros((1, len(p.graph)), dtype=bool)
    for first, end in itertools.pairwise([0, *ends.tolist()]):
        component = rows[order[first:end]]
        key = component.tobytes() + (p.start[component].tobytes() if q.warm else b"")
        if key not in solved:
            solved[key] = _solve_component(p, component, q)
        weight, held = solved[key]
        sums = (total[:, None] + weight).ravel()
        best = np.argsort(-sums, kind="stable")[: q.k_h]
        total, out = sums[best], out[best // len(weight)]
        out[:, component] = held[best % len(weight)]
    return out


def _solve_component(p: Problem, component: Ints, q: MhtParameters) -> tuple[Array, Mask]:
    """The local optima of one search in a component, at most K_H, the best first; weights (k,), and (k, rows) as in Solved.

    The best one is proved or improved by Lagrangian bounds.
    """
    graph = p.graph.within(component)
    if not graph.edges:
        order = np.argsort(-graph.weight, kind="stable")[: q.k_h]
        return graph.weight[order], np.arange(len(component)) == order[:, None]
    start = warm_start(graph, p.start[component]) if q.warm else None
    if q.prove and q.k_h == 1:
        known = np.zeros(0, dtype=np.int64) if start is None else start
        best, _ = heaviest_clique(graph, known, Effort(_moves(graph, q), p.seed, q.branches))
        optima = [best]
    else:
        found = search(graph, Limits(moves=_moves(graph, q)), p.seed, Options(keep=q.k_h, start=start, tuning=Tuning(T=10)))
        optima = [best for _, best in found.optima] or [found.vertices]
        better = heaviest_clique(graph, optima[0], Effort(0, p.seed, q.branches))[0] if q.prove else optima[0]
        if graph.weight[better].sum() > graph.weight[optima[0]].sum() + 1e-9:
            optima = [better, *optima][: q.k_h]
    if q.graphs is not None:
        dump(q.graphs, f"{p.seed:08d}-{component.min()}", graph, optima[0])
    held = np.zeros((len(optima), len(component)), dtype=bool)
    for row, rows in zip(held, optima, strict=True):
        row[rows] = True
    return np.array([graph.weight[rows].sum() for rows in optima]), held


def _moves(graph: Graph, q: MhtParameters) -> int:
    """Moves of the local search in a graph."""
    return min(max(10 * graph.edges, 200), q.i_bls_max)


@njit(cache=True)
def _greedy_clique(start: Ints, conflict: Ints, order: Ints) -> Ints:
    """The vertices in `order` without those that exclude a chosen one."""
    free, out, n = np.ones(len(order), np.bool_), np.empty(len(order), np.int64), 0
    for v in order:
        if free[v]:
            out[n] = v
            n += 1
            free[conflict[start[v] : start[v + 1]]] = False
    return out[:n].copy()
