"""Maximum-weight cliques by Lagrangian bounds against HiGHS (scipy's milp), on set packings like those of trackers and on random graphs."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import Bounds, LinearConstraint, milp

from tracker.clique.clique_cover import conflict_classes, dominated, partition
from tracker.clique.local_search import Graph
from tracker.clique.set_packing import Effort, heaviest_clique


def packing(seed: int, trees: int = 12, boxes: int = 26) -> Graph:
    """Leaves of trees with up to three boxes each: those of one tree, or with a common box, exclude each other, and some other pairs do."""
    rng = np.random.default_rng(seed)
    tree = np.repeat(np.arange(trees), 8)
    taken = np.zeros((len(tree), boxes), dtype=bool)
    for row, near in zip(taken, 2 * tree, strict=True):
        row[(near + rng.choice(14, rng.integers(1, 4), replace=False)) % boxes] = True
    conflict = (tree[:, None] == tree) | (taken.astype(int) @ taken.T > 0) | np.isin(np.arange(len(tree)), rng.choice(len(tree), 4))
    conflict &= conflict.T & ~np.eye(len(tree), dtype=bool)
    return Graph.from_conflicts(rng.uniform(5, 9, len(tree)) + 3 * taken.sum(axis=1), np.argwhere(conflict))


def random_graph(seed: int, n: int = 40) -> Graph:
    rng = np.random.default_rng(seed)
    return Graph.from_conflicts(rng.exponential(1.0, n), np.argwhere(np.triu(rng.random((n, n)) < 0.2, 1)))


def by_milp(graph: Graph) -> float:
    """The weight of the heaviest clique, by a constraint for each class; another test checks the classes."""
    first, member = conflict_classes(graph.start, graph.conflict)
    A = np.zeros((len(first) - 1, len(graph)))
    A[np.repeat(np.arange(len(A)), np.diff(first)), member] = 1
    rows = LinearConstraint(A, -np.inf, 1)
    return -float(milp(-graph.weight, constraints=rows, bounds=Bounds(0, 1), integrality=np.ones(len(graph)), options={"mip_rel_gap": 0}).fun)


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("make", [packing, random_graph])
def test_the_proved_clique_is_the_optimum(make: type, seed: int) -> None:
    graph = make(seed)
    best, proved = heaviest_clique(graph, np.zeros(0, dtype=np.int64), Effort())
    assert proved
    assert graph.is_clique(best)
    assert graph.weight[best].sum() == pytest.approx(by_milp(graph), rel=1e-9)


def test_the_known_clique_is_a_lower_bound_and_results_repeat() -> None:
    graph = random_graph(1, 60)
    known = heaviest_clique(graph, np.zeros(0, dtype=np.int64), Effort(moves=50, branches=1))[0]
    first, again = (heaviest_clique(graph, known, Effort(moves=0, branches=1))[0] for _ in range(2))
    assert graph.is_clique(first)
    assert graph.weight[first].sum() >= graph.weight[known].sum()
    np.testing.assert_array_equal(first, again)


def test_classes_cover_the_conflicts_and_groups_lie_within_classes() -> None:
    graph = packing(5)
    conflict = np.zeros((len(graph), len(graph)), dtype=bool)
    conflict[np.repeat(np.arange(len(graph)), np.diff(graph.start)), graph.conflict] = True
    first, member = conflict_classes(graph.start, graph.conflict)
    covered = np.zeros_like(conflict)
    for rows in np.split(member, first[1:-1]):
        assert conflict[np.ix_(rows, rows)].sum() == len(rows) * (len(rows) - 1)
        covered[np.ix_(rows, rows)] = True
    assert covered[conflict].all()
    group, groups, whole = partition(first, member, len(graph))
    assert sorted(set(group.tolist())) == list(range(groups))
    assert len(whole) == len(first) - 1
    same = (group[:, None] == group) & ~np.eye(len(graph), dtype=bool)
    assert conflict[same].all()


def test_dominated_vertices() -> None:
    # 0 and 1 exclude each other, and 1 excludes 2, too: 1 is needed only where it is heavier than 0.
    pairs = [[0, 1], [1, 2]]
    for weight, out in (([2.0, 2.0, 1.0], [1]), ([2.0, 2.5, 1.0], []), ([1.0, 2.5, 2.0], [])):
        graph = Graph.from_conflicts(weight, pairs)
        assert np.flatnonzero(dominated(graph.weight, graph.start, graph.conflict)).tolist() == out
