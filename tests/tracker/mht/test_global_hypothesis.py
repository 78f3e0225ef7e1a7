"""The global hypothesis: the chosen clique of every graph of a run against its proved optimum."""

from __future__ import annotations

import itertools
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tracker.clique.branch_and_bound import exact
from tracker.clique.local_search import Graph
from tracker.datasets import synthetic_crowd
from tracker.formats.dimacs import read_graph
from tracker.mht.global_hypothesis import Problem, _optima, solve
from tracker.mht.parameters import MhtParameters
from tracker.pipeline import Parameters, Tracker, track


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


def test_a_leaf_that_is_too_fast_to_be_kept_is_not_chosen() -> None:
    """Its tree keeps a leaf that agrees with the others: it is pruned after the choice, and would take the place of these."""
    rng = np.random.default_rng(3)
    setup = synthetic_crowd.setup()
    tracker = Tracker(setup, Parameters())
    for tick in synthetic_crowd.ticks(setup, synthetic_crowd.paths(8, 15, rng), rng, clutter=0.2):
        tracker.step(tick)
    mht = tracker._people.filter
    leaves, conflicts, none = mht.leaves, mht._conflicts, np.zeros((0, len(mht.leaves)), dtype=bool)
    first = solve(leaves, conflicts, none, mht.parameters, 0).best
    tree, count = np.unique(leaves.tree[leaves.score > 0], return_counts=True)
    fast = next(int(k) for k in first if leaves.tree[k] in tree[count > 1])
    state = leaves.state.copy()
    state[fast, 2:4] = 1.1 * mht.parameters.motion.v_max, 0.0
    then = solve(replace(leaves, state=state), conflicts, none, mht.parameters, 0).best
    assert fast not in then
    assert leaves.tree[fast] in leaves.tree[then]
