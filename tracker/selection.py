"""The best set of tracks: a maximum-weight clique of leaves that may be true together."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tracker.bonds import Bonds, among, parts
from tracker.clique import Graph, Limits, Options, Tuning, search
from tracker.dumping import dump
from tracker.fusion import FusionParameters
from tracker.geometry import Array
from tracker.leaves import Leaves, weights
from tracker.measurements import Ints
from tracker.packing import Effort, settled
from tracker.trees import MotionParameters

Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class MultipleParameters:
    """Named as in the paper where it has a name for it; times in seconds, so that other frame rates work."""

    fusion: FusionParameters = field(default_factory=FusionParameters)
    motion: MotionParameters = field(default_factory=lambda: MotionParameters(acceleration=0.8, foot_spread=0.2))
    min_confidence: float = 0.6  # boxes below are not looked at
    birth_confidence: float = 0.8  # and below this they start nobody
    false_positive: float = 0.05  # FP
    false_negative: float = 0.1  # FN
    clutter: float = 2.0  # false boxes a steradian: what a box must beat to be taken
    gate: float = 4.0  # standard deviations of the innovation
    hidden_feet: float = 0.15  # how often a box ends above the feet for no reason that is known
    delta_a: float = 9 / 7  # s, longest gap that is bridged
    n_conf: int = 2  # ticks until a track may be believed
    n_scan: float = 10 / 7  # s, after which a decision stands
    believe: float = 6.0  # log-likelihood ratio from which it is
    birth: float = -3.0  # log of the density of new people over that of false boxes
    confirmation: float = 4.0  # log-likelihood ratio of each further view of a new person
    same_person: float = 1.0  # m, two tracks nearer than this that no view tells apart are one person ...
    together: int = 4  # ... after so many ticks
    offset_sigma: float = 0.3  # m, how far a view may be off on the ground for good; 0 switches the correction off
    offset_memory: float = 30.0  # innovations that are worth one independent look at the offset: they come in runs
    least: float = 0.0  # log-likelihood ratio that a box must have to be taken
    width: float = 15.0  # log-likelihood by which a way to go on may be worse than the leaf's best
    slack: float = 4.0  # the same where no other tree wants the boxes of the best way
    beam: int = 8  # ways that are followed from view to view
    children: int = 3  # ways kept of a leaf, beside those that leave a contested box to others
    tree_leaves: int = 8  # leaves kept of a tree
    young_leaves: int = 4  # the same while nobody is believed there
    most_regret: float = 15.0  # log-likelihood by which the best hypothesis with a leaf may be worse than the best of all
    patience: int = 4  # ticks that a young tree may be out of the best hypothesis
    most_leaves: int = 160  # leaves kept in all; each has several children, and every two of them are compared
    most_weight: float = 30.0  # weight that a tree's best leaf has at most
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
    """best: rows of the leaves in the best hypothesis; hypotheses: rows of each that is kept, the best first, at most K_H; conflict
    (n, n): which leaves exclude each other."""

    best: Ints
    hypotheses: list[Ints]
    conflict: Mask


def select(leaves: Leaves, bonds: Bonds, previous: list[Mask], parameters: MultipleParameters, seed: int) -> Selection:
    """Which leaves are true; previous: for each hypothesis of the tick before, which leaves are children of its leaves."""
    q = parameters
    weight = weights(leaves, q.most_weight)
    usable = (weight > 0) & (leaves.score > 0)
    patience = np.where(leaves.believed[:, None] & leaves.believed[None, :], q.together, max(1, q.together // 2))
    conflict = bonds.conflict | (bonds.together >= patience)
    np.fill_diagonal(conflict, False)
    if not q.small_graphs or not previous:
        start = previous[0] if previous else np.zeros(len(leaves), dtype=bool)
        found = _optima(Problem(weight, conflict, start, seed), np.flatnonzero(usable), replace(q, k_h=1), {})
        return Selection(found[0], found, conflict)
    young = usable & ~leaves.believed
    sets: dict[bytes, tuple[float, Ints]] = {}
    solved: Solved = {}
    for k, children in enumerate(previous):
        rows = np.flatnonzero(young | (usable & children))
        for rows_found in _optima(Problem(weight, conflict, children, seed + 1000 * k), rows, q, solved):
            sets.setdefault(rows_found.tobytes(), (float(weight[rows_found].sum()), rows_found))
    ranked = [rows for _, rows in sorted(sets.values(), key=lambda s: -s[0])][: q.k_h]
    return Selection(ranked[0], ranked, conflict)


def _parts(conflict: NDArray[np.bool_], rows: Ints) -> list[Ints]:
    """Rows by connected parts of the conflict graph: what is chosen in one says nothing of another."""
    label = parts(conflict, rows)
    order = np.argsort(label, kind="stable")
    return np.split(rows[order], np.flatnonzero(np.diff(label[order])) + 1) if len(rows) else []


Solved = dict[bytes, tuple[Array, list[Ints]]]
"""Weights and rows of the optima of parts, by the rows of a part and where its search began."""


@dataclass(frozen=True, eq=False)
class Problem:
    """weight (n,), conflict (n, n) of the leaves, start (n,): where to begin; seed of the search."""

    weight: Array
    conflict: Mask
    start: Mask
    seed: int


def _moves(graph: Graph, q: MultipleParameters) -> int:
    return min(max(10 * graph.edges, 200), q.i_bls_max)


def survivors(graph: Graph, start: Mask) -> Ints:
    """Vertices to begin with: the heaviest of `start` (n,) that go together, then the heaviest of the others that do."""
    free, out = np.ones(len(graph), dtype=bool), []
    for k in np.lexsort((-graph.weight, ~start)):
        if free[k]:
            out.append(k)
            free[graph.conflict[graph.start[k] : graph.start[k + 1]]] = False
    return np.array(out, dtype=np.int64)


def _optima(p: Problem, rows: Ints, q: MultipleParameters, solved: Solved) -> list[Ints]:
    """The heaviest sets, at most K_H: the local optima of each part in all combinations. A part that another hypothesis has, too, is `solved`."""
    found = []
    for part in _parts(p.conflict, rows):
        key = part.tobytes() + (p.start[part].tobytes() if q.warm else b"")
        if key not in solved:
            solved[key] = _of_part(p, part, q)
        found.append(solved[key])
    total, choice = np.zeros(1), np.zeros((1, 0), dtype=np.int64)
    for weight, _ in found:
        sums = (total[:, None] + weight[None, :]).ravel()
        best = np.argsort(-sums, kind="stable")[: q.k_h]
        total, choice = sums[best], np.column_stack([choice[best // len(weight)], best % len(weight)])
    nothing = np.zeros(0, dtype=np.int64)
    return [np.sort(np.concatenate([nothing, *(sets[c] for (_, sets), c in zip(found, row, strict=True))])) for row in choice.tolist()]


def _of_part(p: Problem, part: Ints, q: MultipleParameters) -> tuple[Array, list[Ints]]:
    """Weights and rows of the local optima of one search in a part, at most K_H, the best first; that one is proved or mended."""
    weight = p.weight[part]
    graph = Graph.from_rows(weight, *among(p.conflict, part))
    if not graph.edges:
        order = np.argsort(-weight, kind="stable")[: q.k_h]
        return weight[order], [part[[k]] for k in order]
    start = survivors(graph, p.start[part]) if q.warm else None
    if q.mended and q.k_h == 1:
        best, _ = settled(graph, np.zeros(0, dtype=np.int64) if start is None else start, Effort(_moves(graph, q), p.seed, q.branches))
        optima = [best]
    else:
        found = search(graph, Limits(moves=_moves(graph, q)), p.seed, Options(keep=q.k_h, start=start, tuning=Tuning(T=10)))
        optima = [best for _, best in found.optima] or [found.vertices]
        better = settled(graph, optima[0], Effort(0, p.seed, q.branches))[0] if q.mended else optima[0]
        if weight[better].sum() > weight[optima[0]].sum() + 1e-9:
            optima = [better, *optima][: q.k_h]
    if q.graphs is not None:
        dump(q.graphs, f"{p.seed:08d}-{part.min()}", graph, optima[0])
    return np.array([weight[rows].sum() for rows in optima]), [part[rows] for rows in optima]
