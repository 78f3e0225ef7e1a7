"""Maximum-weight cliques against brute force, proofs and the best known weights."""

from __future__ import annotations

import csv
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tracker.clique.clique_cover import component_labels
from tracker.clique.dimacs import read_graph
from tracker.clique.exact_clique import exact
from tracker.clique.local_search import Graph, Limits, Options, search


def random_graph(seed: int, most: int) -> Graph:
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, most))
    weight = rng.integers(1, 9, n) if rng.random() < 0.5 else rng.uniform(0.01, 5, n)
    return Graph.from_conflicts(weight, np.argwhere(np.triu(rng.random((n, n)) < rng.random(), 1)))


def brute_force(graph: Graph) -> float:
    n = len(graph)
    subsets = ([v for v in range(n) if mask >> v & 1] for mask in range(1, 1 << n))
    return max(float(graph.weight[s].sum()) for s in subsets if graph.is_clique(s))


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=120, deadline=None)
def test_small_graphs_are_solved(seed: int) -> None:
    graph = random_graph(seed, 11)
    best = brute_force(graph)
    proved, found = exact(graph), search(graph, Limits(moves=400), seed)
    for result in (proved, found):
        assert result.weight == pytest.approx(best, rel=1e-12)
        assert graph.is_clique(result.vertices)
        assert graph.weight[result.vertices].sum() == pytest.approx(result.weight)


@pytest.mark.parametrize("seed", range(8))
def test_search_reaches_the_proved_optimum_on_larger_graphs(seed: int) -> None:
    rng = np.random.default_rng(seed)
    graph = Graph.from_conflicts(rng.exponential(1.0, 90), np.argwhere(np.triu(rng.random((90, 90)) < 0.35, 1)))
    assert search(graph, Limits(moves=20_000), seed).weight == pytest.approx(exact(graph).weight)


def test_subgraphs_and_connected_components() -> None:
    graph = Graph.from_conflicts([1.0, 2.0, 3.0, 4.0, 5.0, 6.0], [[0, 3], [3, 4], [1, 2]])
    some = graph.within(np.array([0, 3, 4]))
    assert (some.weight.tolist(), some.start.tolist(), some.conflict.tolist()) == ([1.0, 4.0, 5.0], [0, 1, 3, 4], [1, 0, 2, 1])
    for rows, parts in ((np.arange(6), [0, 1, 1, 0, 0, 2]), (np.array([0, 4, 1]), [0, 1, 2]), (np.zeros(0, dtype=np.int64), [])):
        assert component_labels(graph.start, graph.conflict, rows).tolist() == parts
    assert len(graph.within(np.zeros(0, dtype=np.int64))) == 0


def test_renaming_vertices_renames_the_clique() -> None:
    graph = random_graph(8, 14)
    shuffle = np.random.default_rng(0).permutation(len(graph))
    rows = np.repeat(np.arange(len(graph)), np.diff(graph.start))
    renamed = Graph.from_conflicts(graph.weight[np.argsort(shuffle)], np.column_stack([shuffle[rows], shuffle[graph.conflict]]))
    assert exact(renamed).weight == pytest.approx(exact(graph).weight)


def test_the_same_seed_makes_the_same_moves() -> None:
    rng = np.random.default_rng(2)
    graph = Graph.from_conflicts(rng.uniform(1, 2, 60), np.argwhere(np.triu(rng.random((60, 60)) < 0.5, 1)))
    a, b = (search(graph, Limits(moves=5000), 7, Options(keep=5)) for _ in range(2))
    assert (a.weight, a.moves, a.vertices.tolist()) == (b.weight, b.moves, b.vertices.tolist())
    assert [w for w, _ in a.optima] == [w for w, _ in b.optima]


def test_more_moves_are_never_worse_and_the_start_is_a_lower_bound() -> None:
    rng = np.random.default_rng(3)
    graph = Graph.from_conflicts(rng.uniform(1, 2, 80), np.argwhere(np.triu(rng.random((80, 80)) < 0.5, 1)))
    weights = [search(graph, Limits(moves=moves), 1).weight for moves in (1, 10, 100, 1000, 10000)]
    assert weights == sorted(weights)
    best = search(graph, Limits(moves=10000), 1)
    assert search(graph, Limits(moves=1), 5, Options(start=best.vertices)).weight >= best.weight


def test_local_optima_are_distinct_maximal_cliques() -> None:
    rng = np.random.default_rng(4)
    graph = Graph.from_conflicts(rng.uniform(1, 2, 40), np.argwhere(np.triu(rng.random((40, 40)) < 0.4, 1)))
    found = search(graph, Limits(moves=3000), 0, Options(keep=12))
    assert len(found.optima) == 12
    assert len({tuple(v.tolist()) for _, v in found.optima}) == 12
    assert found.optima[0][0] == pytest.approx(found.weight)
    for weight, vertices in found.optima:
        assert graph.is_clique(vertices)
        assert graph.weight[vertices].sum() == pytest.approx(weight)
        assert not any(graph.is_clique([*vertices, v]) for v in range(len(graph)) if v not in vertices)


def test_graphs_without_vertices_or_conflicts() -> None:
    assert search(Graph.from_conflicts([], []), Limits(moves=10)).weight == 0
    assert exact(Graph.from_conflicts([], [])).weight == 0
    free = search(Graph.from_conflicts([1.0, 2.0, 3.0], []), Limits(moves=10))
    assert free.vertices.tolist() == [0, 1, 2]


@pytest.mark.parametrize(
    ("weight", "pairs", "message"),
    [
        ([1.0, 0.0], [], "weight of vertex 1 is 0.0"),
        ([1.0, -2.0], [], "weight of vertex 1 is -2.0"),
        ([1.0, np.nan], [], "weight of vertex 1 is nan"),
        ([1.0, 1.0], [[1, 1]], "vertex 1 is paired with itself"),
        ([1.0, 1.0], [[0, 2]], "vertex 2 does not exist"),
    ],
)
def test_bad_graphs_are_refused(weight: list[float], pairs: list[list[int]], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Graph.from_conflicts(weight, pairs)


def test_a_bad_start_and_missing_limits_are_refused() -> None:
    graph = Graph.from_conflicts([1.0, 1.0], [[0, 1]])
    with pytest.raises(ValueError, match="start is no clique"):
        search(graph, Limits(moves=5), options=Options(start=[0, 1]))
    with pytest.raises(ValueError, match="needs a limit"):
        Limits()


def test_best_known_weights_on_real_graphs(data: Callable[..., Path]) -> None:
    """Instances that take well under a second each; others are in the benchmark. MANN_a27 is left out: 10 s give 12271 to 12275 of 12283."""
    with data("clique", "optima.csv").open() as file:
        best = {row["instance"]: float(row["weighted_imod200p1"]) for row in csv.DictReader(file)}
    for name, weight in best.items():
        if name == "MANN_a27":
            continue
        graph = read_graph(data("clique", f"{name}.clq"))
        found = search(graph, Limits(seconds=10, target=weight), seed=11)
        assert found.weight == weight, name
        assert graph.is_clique(found.vertices)
        if name in ("brock200_2", "keller4", "p_hat300-1"):
            assert exact(graph).weight == weight
