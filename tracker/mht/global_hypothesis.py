"""The global hypothesis: the maximum-weight clique of compatible leaves (Reid 1979; Kim et al. 2015, section 3.4)."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tracker.clique.clique_cover import component_labels
from tracker.clique.dimacs import write_graph
from tracker.clique.local_search import Graph, Limits, Options, search
from tracker.clique.set_packing import Effort, heaviest_clique
from tracker.geometry import Array, Ints, Mask
from tracker.geometry.compilation import njit
from tracker.mht.track_trees import TrackHypotheses
from tracker.tracks.parameters import MhtParameters


@dataclass(frozen=True, eq=False)
class GlobalHypothesis:
    """best: rows of the leaves in the global hypothesis; conflict (n, n): which leaves exclude each other.

    hypotheses (k, n): the leaves of each hypothesis that is kept, the best first, at most K_H.
    """

    best: Ints
    hypotheses: Mask
    conflict: Mask


@dataclass(frozen=True, eq=False)
class Component:
    """Leaves that are connected by conflicts: their graph, a clique `start` to start from, the seed of a search, and a name within a run."""

    graph: Graph
    start: Ints
    seed: int
    name: str


CliqueSolver = Callable[[Component, MhtParameters], list[Ints]]
"""Heavy cliques of a component that has compatible vertices: different ones, the best first, at most K_H."""

Solved = dict[bytes, tuple[Array, Mask]]
"""Key: rows and start of a component. Value: weights (k,) of its optima, and which of its rows (k, rows) each holds."""


class HypothesisSearch:
    """The search for the global hypothesis, with a solver of graphs."""

    def __init__(self, parameters: MhtParameters, solver: CliqueSolver | None = None) -> None:
        self.parameters, self.solver = parameters, solver or proved_cliques

    def solve(self, leaves: TrackHypotheses, conflict: Mask, previous: Mask, seed: int) -> GlobalHypothesis:
        """The global hypothesis.

        conflict (n, n): as of `conflicts_of`. previous (k, n): for each hypothesis of the last tick, which leaves are children of its leaves.
        """
        q = self.parameters
        weight = leaves.score
        # A leaf that is too fast is not kept. If it were chosen here, N-scan pruning would remove other leaves of its tree.
        usable = (weight > 0) & (leaves.speed <= q.motion.v_max)
        # Leaves that are not usable stay in the graph, but are never chosen.
        graph = Graph.from_rows(weight, np.count_nonzero(conflict, axis=1), np.flatnonzero(conflict) % max(len(weight), 1))
        solved: Solved = {}
        if q.k_h == 1 or not len(previous):
            start = previous[0] if len(previous) else np.zeros(len(leaves), dtype=bool)
            found = self.optima(graph, np.flatnonzero(usable), start, seed, solved)[:1]
        else:
            tentative = usable & ~leaves.confirmed
            sets: dict[bytes, Mask] = {}
            for k, children in enumerate(previous):
                for held in self.optima(graph, np.flatnonzero(tentative | (usable & children)), children, seed + 1000 * k, solved):
                    sets.setdefault(held.tobytes(), held)
            found = np.array(sorted(sets.values(), key=lambda held: -weight[held].sum())[: q.k_h])
        return GlobalHypothesis(np.flatnonzero(found[0]), found, conflict)

    def optima(self, graph: Graph, rows: Ints, start: Mask, seed: int, solved: Solved) -> Mask:
        """The heaviest cliques (k, n) among `rows`, at most K_H; start (n,): vertices that a search starts from.

        Connected components of the conflicts are independent: their local optima are combined in all ways. A component in `solved` is not
        solved again.
        """
        label = component_labels(graph.start, graph.conflict, rows)
        order = np.argsort(label, kind="stable")
        ends = np.flatnonzero(np.diff(label[order], append=-1)) + 1
        total, out = np.zeros(1), np.zeros((1, len(graph)), dtype=bool)
        for first, end in itertools.pairwise([0, *ends.tolist()]):
            component = rows[order[first:end]]
            key = component.tobytes() + start[component].tobytes()
            if key not in solved:
                solved[key] = self._solve_component(graph.within(component), start[component], seed, f"{seed:08d}-{component.min()}")
            weight, held = solved[key]
            sums = (total[:, None] + weight).ravel()
            best = np.argsort(-sums, kind="stable")[: self.parameters.k_h]
            total, out = sums[best], out[best // len(weight)]
            out[:, component] = held[best % len(weight)]
        return out

    def _solve_component(self, graph: Graph, start: Mask, seed: int, name: str) -> tuple[Array, Mask]:
        """Cliques of a component, at most K_H, the best first; weights (k,), and (k, rows) as in Solved."""
        q = self.parameters
        if not graph.edges:
            order = np.argsort(-graph.weight, kind="stable")[: q.k_h]
            return graph.weight[order], np.arange(len(graph)) == order[:, None]
        optima = self.solver(Component(graph, warm_start(graph, start), seed, name), q)
        held = np.zeros((len(optima), len(graph)), dtype=bool)
        for row, rows in zip(held, optima, strict=True):
            row[rows] = True
        return np.array([graph.weight[rows].sum() for rows in optima]), held


def proved_cliques(component: Component, q: MhtParameters) -> list[Ints]:
    """The local optima of one search, of which the best one is proved or improved by Lagrangian bounds (tracker/clique/set_packing.py)."""
    graph = component.graph
    if q.k_h == 1:
        return [heaviest_clique(graph, component.start, Effort(moves_of(graph, q), component.seed, q.branches))[0]]
    optima = searched_cliques(component, q)
    better = heaviest_clique(graph, optima[0], Effort(0, component.seed, q.branches))[0]
    return [better, *optima][: q.k_h] if graph.weight[better].sum() > graph.weight[optima[0]].sum() + 1e-9 else optima


def searched_cliques(component: Component, q: MhtParameters, warm: bool = True) -> list[Ints]:
    """The local optima of one search without a proof. warm: whether it starts from the surviving tracks, or from a greedy clique."""
    graph, start = component.graph, component.start if warm else None
    found = search(graph, Limits(moves=moves_of(graph, q)), component.seed, Options(keep=q.k_h, start=start, T=10))
    return [best for _, best in found.optima] or [found.vertices]


def moves_of(graph: Graph, q: MhtParameters) -> int:
    """Moves of the local search in a graph."""
    return min(max(10 * graph.edges, 200), q.i_bls_max)


def written_to(folder: Path, solver: CliqueSolver | None = None) -> CliqueSolver:
    """A solver that also writes each graph and its clique into a folder, as `dump` does."""
    inner = solver or proved_cliques

    def solve(component: Component, q: MhtParameters) -> list[Ints]:
        optima = inner(component, q)
        dump(folder, component.name, component.graph, optima[0])
        return optima

    return solve


def dump(folder: Path, name: str, graph: Graph, chosen: Ints) -> None:
    """Write `graph` as folder/NAME.clq (DIMACS, weighted), and the vertices of the chosen clique, counted from 1, as folder/NAME.txt."""
    folder.mkdir(parents=True, exist_ok=True)
    write_graph(folder / f"{name}.clq", graph)
    (folder / f"{name}.txt").write_text(" ".join(str(v + 1) for v in chosen.tolist()) + "\n", encoding="utf-8")


def warm_start(graph: Graph, start: Mask) -> Ints:
    """A clique to start from: the heaviest vertices of `start` (n,) first, then the others, each where no chosen one excludes it."""
    out: Ints = _greedy_clique(graph.start, graph.conflict, np.lexsort((-graph.weight, ~start)))
    return out


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
