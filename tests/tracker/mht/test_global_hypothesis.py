"""The global hypothesis: the chosen clique of every graph of a run against its proved optimum."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
import pytest

from tracker.clique.branch_and_bound import exact
from tracker.clique.local_search import Graph
from tracker.datasets import synthetic_crowd
from tracker.formats.dimacs import read_graph
from tracker.mht.global_hypothesis import Problem, _optima
from tracker.mht.parameters import MhtParameters
from tracker.pipeline import Parameters, track


def gaps(folder: Path, many: MhtParameters) -> np.ndarray:
    """Relative gap to the optimum of each graph of a run on a crowd with clutter."""
    rng = np.random.default_rng(3)
    setup, walked = synthetic_crowd.setup(), synthetic_crowd.paths(8, 15, rng)
    list(track(setup, synthetic_crowd.ticks(setup, walked, rng, clutter=0.2), Parameters(targets=many)))
    out = []
    for path in sorted(folder.glob("*.clq")):
        graph = read_graph(path)
        chosen = np.array(path.with_suffix(".txt").read_text().split(), dtype=np.int64) - 1
        assert graph.is_clique(chosen), path
        out.append(1 - float(graph.weight[chosen].sum()) / exact(graph).weight)
    return np.array(out)


@pytest.mark.parametrize("small", [False, True])
@pytest.mark.parametrize("warm", [False, True])
def test_the_chosen_cliques_are_optimal(tmp_path: Path, small: bool, warm: bool) -> None:
    gap = gaps(tmp_path, MhtParameters(small_graphs=small, warm=warm, k_h=3, graphs=tmp_path))
    assert len(gap) >= 5
    assert (gap < 1e-6).mean() >= 0.995
    assert gap.mean() <= 1e-4


def test_the_best_cliques_combine_those_of_the_components() -> None:
    """Four components of leaves that exclude each other: the heaviest cliques against every choice of one leaf of each component."""
    rng = np.random.default_rng(4)
    tree = np.repeat(np.arange(4), 3)
    weight = rng.uniform(1, 5, len(tree))
    conflict = (tree[:, None] == tree[None, :]) & ~np.eye(len(tree), dtype=bool)
    problem = Problem(Graph.from_matrix(weight, conflict), np.zeros(len(tree), dtype=bool), 0)
    found = _optima(problem, np.arange(len(tree)), MhtParameters(k_h=6), {})
    every = [np.array(rows) for rows in itertools.product(*(np.flatnonzero(tree == k) for k in range(4)))]
    best = sorted((float(weight[rows].sum()) for rows in every), reverse=True)[:6]
    np.testing.assert_allclose([weight[held].sum() for held in found], best)
