"""The best set of tracks: a maximum-weight clique of leaves that may be true together."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from tracker.bonds import Bonds, heaviest
from tracker.clique import Graph, Limits, Options, Tuning, search
from tracker.dumping import dump
from tracker.exact_clique import improved
from tracker.fusion import FusionParameters
from tracker.geometry import Array
from tracker.leaves import Leaves, weights
from tracker.measurements import Ints
from tracker.trees import MotionParameters

Mask = NDArray[np.bool_]

NODE_ROWS = 4_000_000
"""Rows looked at by branch and bound in one part, at most: what bounds the time of a tick."""
BRANCH_ROWS = 200_000
"""The same for the branch and bound by colouring that goes on from what the search found."""


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
    most_leaves: int = 600  # leaves kept in all; each has several children, and every two of them are compared
    most_weight: float = 30.0  # weight that a tree's best leaf has at most
    k_h: int = 25  # K_H, hypotheses kept
    i_bls_max: int = 2000  # moves of the search at most
    nodes: int = 20_000  # leaves that branch and bound tries before the search takes over
    seed: int = 0  # of the searches
    graphs: Path | None = None  # where every graph that is solved is written, with the clique that was chosen
    small_graphs: bool = False  # a graph for each hypothesis of the tick before, rather than one of all leaves
    warm: bool = True  # whether the search begins with the tracks that survive, or with the heaviest


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
        found = _by_part(Problem(weight, conflict, leaves.tree, start, seed), np.flatnonzero(usable), q)
        return Selection(found, [found], conflict)
    young = usable & ~leaves.believed
    sets: dict[bytes, tuple[float, Ints]] = {}
    for k, children in enumerate(previous):
        rows = np.flatnonzero(young | (usable & children))
        for rows_found in _optima(Problem(weight, conflict, leaves.tree, children, seed + 1000 * k), rows, q):
            sets.setdefault(rows_found.tobytes(), (float(weight[rows_found].sum()), rows_found))
    ranked = [rows for _, rows in sorted(sets.values(), key=lambda s: -s[0])][: q.k_h]
    return Selection(ranked[0], ranked, conflict)


def _parts(conflict: NDArray[np.bool_], rows: Ints) -> list[Ints]:
    """Rows by connected parts of the conflict graph: what is chosen in one says nothing of another."""
    if not len(rows):
        return []
    _, label = connected_components(csr_array(conflict[np.ix_(rows, rows)]), directed=False)
    order = np.argsort(label, kind="stable")
    return np.split(rows[order], np.flatnonzero(np.diff(label[order])) + 1)


@dataclass(frozen=True, eq=False)
class Problem:
    """weight (n,), conflict (n, n), tree (n,) of the leaves, start (n,): where to begin; seed of the search."""

    weight: Array
    conflict: Mask
    tree: Ints
    start: Mask
    seed: int


def _by_part(p: Problem, rows: Ints, q: MultipleParameters) -> Ints:
    """The heaviest set, part by part: a search from the tracks that survive, then proved or mended by branch and bound as far as that goes."""
    chosen = [np.zeros(0, dtype=np.int64)]
    for part in _parts(p.conflict, rows):
        inner, weight, tree = p.conflict[np.ix_(part, part)], p.weight[part], p.tree[part]
        if inner.sum() == len(part) * (len(part) - 1):
            chosen.append(part[[np.argmax(weight)]])
            continue
        order = np.lexsort((-weight, tree))
        part, inner, weight, tree = part[order], inner[np.ix_(order, order)], weight[order], tree[order]
        known = np.zeros(len(part), dtype=bool)
        known[survivors(weight, inner, p.start[part] & q.warm)] = True
        first = np.append(np.flatnonzero(np.concatenate([[True], tree[1:] != tree[:-1]])), len(tree))
        best, proved = heaviest(weight, inner, first, known, min(q.nodes, NODE_ROWS // len(part)))
        if not proved:
            graph = Graph.from_conflicts(weight, np.argwhere(np.triu(inner)))
            moves = min(max(10 * graph.edges, 200), q.i_bls_max)
            found = search(graph, Limits(moves=moves), p.seed, Options(start=np.flatnonzero(best), tuning=Tuning(T=10)))
            best[:] = False
            best[improved(graph, found.vertices, BRANCH_ROWS // len(part))[0]] = True
        if q.graphs is not None:
            dump(q.graphs, f"{p.seed:08d}-{part.min()}", Graph.from_conflicts(weight, np.argwhere(np.triu(inner))), np.flatnonzero(best))
        chosen.append(part[best])
    return np.sort(np.concatenate(chosen))


def survivors(weight: Array, conflict: Mask, start: Mask) -> Ints:
    """Rows of a set to begin with: the heaviest of `start` that go together, then the heaviest of the others that do."""
    free, out = np.ones(len(weight), dtype=bool), []
    for k in np.lexsort((-weight, ~start)):
        if free[k]:
            out.append(k)
            free &= ~conflict[k]
            free[k] = False
    return np.array(out, dtype=np.int64)


def _optima(p: Problem, rows: Ints, q: MultipleParameters) -> list[Ints]:
    """Sets that are local optima of one search, the best first; trees that conflict with no other give their best leaf."""
    fixed, rest = [np.zeros(0, dtype=np.int64)], [np.zeros(0, dtype=np.int64)]
    for part in _parts(p.conflict, rows):
        (fixed if len(part) == 1 else rest).append(part)
    sure, open_rows = np.concatenate(fixed), np.concatenate(rest)
    if not len(open_rows):
        return [np.sort(sure)]
    open_rows = open_rows[np.lexsort((-p.weight[open_rows], p.tree[open_rows]))]
    return [np.sort(np.concatenate([sure, open_rows[found]])) for found in _search(p, open_rows, q)]


def _search(p: Problem, rows: Ints, q: MultipleParameters) -> list[Ints]:
    """Optima among `rows`, which are in order of their trees, the heaviest of a tree first; the best is mended as far as branch and bound goes."""
    weight, inner = p.weight[rows], p.conflict[np.ix_(rows, rows)]
    graph = Graph.from_conflicts(weight, np.argwhere(np.triu(inner)))
    moves = min(max(10 * graph.edges, 200), q.i_bls_max)
    start = survivors(weight, inner, p.start[rows]) if q.warm else None
    found = search(graph, Limits(moves=moves), p.seed, Options(keep=q.k_h, start=start, tuning=Tuning(T=10)))
    optima = [best for _, best in found.optima] or [found.vertices]
    best = np.zeros(len(rows), dtype=bool)
    for part in _parts(inner, np.arange(len(rows))):
        known, tree, part_conflict = np.isin(part, optima[0]), p.tree[rows[part]], inner[np.ix_(part, part)]
        first = np.append(np.flatnonzero(np.concatenate([[True], tree[1:] != tree[:-1]])), len(tree))
        best[part], proved = heaviest(weight[part], part_conflict, first, known, min(q.nodes, NODE_ROWS // len(part)))
        if not proved:
            graph_of_part = Graph.from_conflicts(weight[part], np.argwhere(np.triu(part_conflict)))
            better, _ = improved(graph_of_part, np.flatnonzero(best[part]), BRANCH_ROWS // len(part))
            best[part] = np.isin(np.arange(len(part)), better)
    if weight[best].sum() > weight[optima[0]].sum() + 1e-9:
        optima = [np.flatnonzero(best), *optima]
    if q.graphs is not None:
        dump(q.graphs, f"{p.seed:08d}-0", graph, optima[0])
    return optima
