"""The best set of tracks: a maximum-weight clique of leaves that may be true together."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numba import njit
from numpy.typing import NDArray

from tracker.bonds import Bonds
from tracker.clique import Graph, Limits, Options, Tuning, search
from tracker.covering import labels
from tracker.dumping import dump
from tracker.evidence import TargetParameters
from tracker.fusion import FusionParameters
from tracker.geometry import Array
from tracker.leaves import Leaves, weights
from tracker.measurements import Ints
from tracker.noise import NoiseParameters
from tracker.offsets import OffsetParameters
from tracker.packing import Effort, settled
from tracker.trees import MotionParameters

Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class MultipleParameters(TargetParameters):
    """What both trackers of people have, and what track trees need beside it; boxes below `min_confidence` are not looked at."""

    motion: MotionParameters = field(default_factory=lambda: MotionParameters(foot_spread=0.2))
    offsets: OffsetParameters = field(default_factory=lambda: OffsetParameters(first=0.05, slope=0.03, slope_first=0.005))
    fusion: FusionParameters = field(default_factory=lambda: FusionParameters(ahead=0.03))
    noise: NoiseParameters = field(default_factory=NoiseParameters)
    n_scan: float = 10 / 7  # s, after which a decision stands
    clutter: float = 2.5  # false boxes a steradian that each view is taken to have at least
    least: float = 2.0  # log-likelihood ratio that a box must have to be taken where the best hypothesis goes on otherwise
    width: float = 15.0  # log-likelihood by which a way to go on may be worse than the leaf's best
    slack: float = 4.0  # the same where no other tree wants the boxes of the best way
    beam: int = 8  # ways that are followed from view to view
    children: int = 3  # ways kept of a leaf, beside those that leave a contested box to others
    tree_leaves: int = 8  # leaves kept of a tree
    young_leaves: int = 4  # the same while nobody is believed there
    most_regret: float = 30.0  # log-likelihood by which the best hypothesis with a leaf may be worse than the best of all
    patience: int = 4  # ticks that a young tree may be out of the best hypothesis
    most_leaves: int = 160  # leaves kept in all; each has several children, and every two of them are compared
    most_weight: float = 60.0  # weight that a tree's best leaf has at most
    alike: float = 0.7  # of what images say of what people look like, where there are images (tracker/likeness.py) ...
    fashion: float = 0.1  # ... and share by which a box renews how somebody looks
    partly: bool = True
    k_h: int = 25  # K_H, hypotheses kept
    i_bls_max: int = 2000  # moves of the search at most
    branches: int = 20  # of a part that is not settled without; they bound the time of a tick
    seed: int = 0  # of the searches
    graphs: Path | None = None  # where every graph that is solved is written, with the clique that was chosen
    small_graphs: bool = False  # a graph for each hypothesis of the tick before, rather than one of all leaves
    warm: bool = True  # whether the search begins with the tracks that survive, or with the heaviest
    mended: bool = True  # whether what the search finds is proved, or mended, by multipliers (tracker/packing.py)


@dataclass(frozen=True, eq=False)
class Selection:
    """best: rows of the leaves in the best hypothesis; hypotheses (k, n): which leaves each holds that is kept, the best first, at most K_H;
    conflict (n, n): which leaves exclude each other."""

    best: Ints
    hypotheses: Mask
    conflict: Mask


def select(leaves: Leaves, bonds: Bonds, previous: Mask, parameters: MultipleParameters, seed: int) -> Selection:
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
    return Selection(np.flatnonzero(found[0]), found, conflict)


Solved = dict[bytes, tuple[Array, Mask]]
"""Weights (k,) of the optima of a part, and which of its rows each holds (k, rows); by the rows and where the search began."""


@dataclass(frozen=True, eq=False)
class Problem:
    """graph of all leaves, also of those that weigh nothing and are never chosen; start (n,): where to begin; seed of the search."""

    graph: Graph
    start: Mask
    seed: int


def _moves(graph: Graph, q: MultipleParameters) -> int:
    return min(max(10 * graph.edges, 200), q.i_bls_max)


def survivors(graph: Graph, start: Mask) -> Ints:
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


def _optima(p: Problem, rows: Ints, q: MultipleParameters, solved: Solved) -> Mask:
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


def _of_part(p: Problem, part: Ints, q: MultipleParameters) -> tuple[Array, Mask]:
    """The local optima of one search in a part, at most K_H, the best first, which is proved or mended; weights (k,), and (k, rows) as in Solved."""
    graph = p.graph.within(part)
    if not graph.edges:
        order = np.argsort(-graph.weight, kind="stable")[: q.k_h]
        return graph.weight[order], np.arange(len(part)) == order[:, None]
    start = survivors(graph, p.start[part]) if q.warm else None
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
