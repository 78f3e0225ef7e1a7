"""Maximum-weight cliques by breakout local search, for any weighted graph.

Benlic & Hao (2013), Breakout local search for maximum clique problems, Computers & Operations Research 40(1). Steepest ascent leads to a local
optimum. The strength and kind of the perturbation that follows depend on the history of the search. A graph is stored as its complement, the pairs
of vertices that exclude each other, which are few for trackers and for hard instances.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from tracker.clique import local_search_kernel
from tracker.geometry import Array, Ints
from tracker.geometry.compilation import njit

CHUNK = 20_000
"""Moves between two checks of the time."""
L0, L_MAX, P0, ALPHA_R, ALPHA_S, PHI = 0.01, 0.1, 0.75, 0.8, 0.8, 7.0
"""Names are those of Benlic & Hao. L0 and L_MAX: strengths as shares of the vertices. P0: least probability of a directed perturbation. ALPHA_R
and ALPHA_S: least share of the weight after a random or strongest perturbation. PHI: least moves for which a dropped vertex is tabu."""


@dataclass(frozen=True, eq=False)
class Graph:
    """Vertices 0 to n − 1 with weights (n,) above 0, and conflicts in CSR form: pairs of vertices that exclude each other.

    The conflicts of vertex v are conflict[start[v] : start[v + 1]], ascending. See `from_conflicts`.
    """

    weight: Array
    start: Ints
    conflict: Ints

    @staticmethod
    def from_conflicts(weight: ArrayLike, pairs: ArrayLike) -> Graph:
        """The graph of weight (n,) and pairs (m, 2) of vertices that exclude each other; a pair may occur twice.

        Raises ValueError for a weight that is not above 0 or not finite, a vertex that does not exist, or one that excludes itself.
        """
        w = np.array(weight, dtype=np.float64).reshape(-1)
        p = np.asarray(pairs, dtype=np.int64).reshape(-1, 2)
        _check(w, p)
        both = np.concatenate([p, p[:, ::-1]])
        # np.unique hashes, which takes seconds on regular numbers like these.
        code = np.sort(both[:, 0] * max(len(w), 1) + both[:, 1])
        row, column = np.divmod(code[np.diff(code, prepend=-1) > 0], max(len(w), 1))
        return Graph.from_rows(w, np.bincount(row, minlength=len(w)), column)

    @staticmethod
    def from_rows(weight: Array, degree: Ints, conflict: Ints) -> Graph:
        """The graph of weight (n,), number of conflicts degree (n,), and the conflicts of each vertex in turn, ascending. Nothing is checked."""
        start = np.concatenate([[0], np.cumsum(degree)]).astype(np.int64)
        for array in (weight, start, conflict):
            array.flags.writeable = False
        return Graph(weight, start, conflict)

    def __len__(self) -> int:
        return len(self.weight)

    def within(self, rows: Ints) -> Graph:
        """The subgraph of the vertices in `rows` (k,), ascending, numbered by their places there."""
        return Graph.from_rows(self.weight[rows], *_conflicts_among(self.start, self.conflict, rows))

    @property
    def edges(self) -> int:
        """Number of pairs of compatible vertices."""
        return (len(self) * (len(self) - 1) - len(self.conflict)) // 2

    def is_clique(self, vertices: ArrayLike) -> bool:
        """Whether the vertices, each given once, are a clique."""
        members = np.asarray(vertices, dtype=np.int64)
        inside = np.zeros(len(self), dtype=bool)
        inside[members] = True
        conflicts = np.concatenate([self.conflict[self.start[v] : self.start[v + 1]] for v in members] or [members])
        return int(inside.sum()) == len(members) and not bool(inside[conflicts].any())


@dataclass(frozen=True, eq=False)
class Found:
    """weight of the best clique; its vertices, ascending; moves and seconds of the search.

    optima: distinct local optima, the heaviest first, each a pair of weight and vertices.
    """

    weight: float
    vertices: Ints
    moves: int
    seconds: float
    optima: tuple[tuple[float, Ints], ...]


@dataclass(frozen=True, eq=False)
class Limits:
    """When a search ends: after this many moves or seconds, or at a clique of at least the target weight; None is no limit.

    A search with a limit of moves gives the same result on every machine; one with a limit of seconds does not.
    """

    moves: int | None = None
    seconds: float | None = None
    target: float | None = None

    def __post_init__(self) -> None:
        if self.moves is None and self.seconds is None:
            raise ValueError("moves and seconds are both None, needs a limit")
        for name in ("moves", "seconds"):
            value = getattr(self, name)
            if value is not None and not value > 0:
                raise ValueError(f"{name} is {value}, needs more than 0")


@dataclass(frozen=True, eq=False)
class Options:
    """start: vertices of a clique to start from, None for a greedy one. keep: number of distinct local optima that are kept.

    T: local optima without a new best before the strongest perturbation.
    """

    start: ArrayLike | None = None
    keep: int = 1
    T: int = 1000


def search(graph: Graph, limits: Limits, seed: int = 0, options: Options | None = None) -> Found:
    """The heaviest clique that breakout local search finds within the limits. The same graph, moves and seed give the same result.

    Raises ValueError where the start is not a clique.
    """
    given = options or Options()
    began = time.perf_counter()
    if not len(graph):
        return Found(0.0, np.zeros(0, dtype=np.int64), 0, 0.0, ())
    if given.start is not None and not graph.is_clique(given.start):
        raise ValueError("start is no clique of this graph")
    n = len(graph)
    state = local_search_kernel.initial_state(graph.weight, graph.start, graph.conflict, np.uint64(seed), max(1, given.keep))
    start = np.zeros(0, np.int64) if given.start is None else np.asarray(given.start, dtype=np.int64)
    local_search_kernel.construct(state, start, given.start is None)
    numbers = (float(given.T), max(1.0, float(np.ceil(L0 * n))), max(2.0, float(np.ceil(L_MAX * n))), P0, ALPHA_R, ALPHA_S, PHI)
    cap = limits.moves if limits.moves is not None else np.iinfo(np.int64).max
    target = np.inf if limits.target is None else float(limits.target)
    while True:
        chunk = cap if limits.seconds is None else min(cap, int(state.counters[local_search_kernel.MOVES]) + CHUNK)
        local_search_kernel.run(state, numbers, chunk, target)
        weight, moves = float(state.totals[local_search_kernel.BEST]), int(state.counters[local_search_kernel.MOVES])
        if moves >= cap or weight >= target or (limits.seconds is not None and time.perf_counter() - began >= limits.seconds):
            break
    optima = local_search_kernel.local_optima(state)
    best = np.flatnonzero(state.best)
    return Found(float(graph.weight[best].sum()), best, moves, time.perf_counter() - began, optima)


@njit(cache=True)
def _conflicts_among(start: Ints, conflict: Ints, rows: Ints) -> tuple[Ints, Ints]:
    """The conflicts among `rows` (k,), vertices numbered by their place there: the number of each, and the conflicts of each in turn."""
    place, degree = np.full(len(start) - 1, -1), np.zeros(len(rows), np.int64)
    place[rows] = np.arange(len(rows))
    others, m = np.empty(len(conflict), np.int64), 0
    for i in range(len(rows)):
        for k in range(start[rows[i]], start[rows[i] + 1]):
            if place[conflict[k]] >= 0:
                others[m] = place[conflict[k]]
                degree[i] += 1
                m += 1
    return degree, others[:m].copy()


def _check(weight: Array, pairs: Ints) -> None:
    """Raise ValueError for weights (n,) and pairs (m, 2) as from_conflicts does."""
    bad = np.flatnonzero(~((weight > 0) & np.isfinite(weight)))
    if len(bad):
        raise ValueError(f"weight of vertex {bad[0]} is {weight[bad[0]]}, needs more than 0")
    missing = pairs[(pairs < 0) | (pairs >= len(weight))]
    if len(missing):
        raise ValueError(f"vertex {missing[0]} does not exist, needs 0 to {len(weight) - 1}")
    loop = np.flatnonzero(pairs[:, 0] == pairs[:, 1])
    if len(loop):
        raise ValueError(f"vertex {pairs[loop[0], 0]} is paired with itself")
