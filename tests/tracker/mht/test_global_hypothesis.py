"""The global hypothesis: the chosen clique of every graph of a run against its proved optimum."""

from __future__ import annotations

import itertools
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from tracker.clique.dimacs import read_graph
from tracker.clique.exact_clique import exact
from tracker.clique.local_search import Graph
from tracker.datasets import synthetic_crowd
from tracker.mht.global_hypothesis import HypothesisSearch, searched_cliques
from tracker.pipeline import Parameters, Tracker, track
from tracker.tracks.parameters import MhtParameters


@pytest.mark.parametrize("k_h", [1, 3])
@pytest.mark.parametrize("warm", [False, True, None])
def test_the_chosen_cliques_are_optimal(tmp_path: Path, k_h: int, warm: bool | None) -> None:
    """The graphs of a run on a crowd with clutter, read from files. warm: start of a search without a proof; None is the default solver."""
    rng = np.random.default_rng(3)
    setup, walked = synthetic_crowd.setup(), synthetic_crowd.paths(8, 15, rng)
    parameters = Parameters(targets=MhtParameters(k_h=k_h), graphs=tmp_path)
    solver = None if warm is None else partial(searched_cliques, warm=warm)
    list(track(setup, synthetic_crowd.ticks(setup, walked, rng, clutter=0.2), parameters, solver=solver))
    found = []
    for path in sorted(tmp_path.glob("*.clq")):
        graph = read_graph(path)
        chosen = np.array(path.with_suffix(".txt").read_text().split(), dtype=np.int64) - 1
        assert graph.is_clique(chosen), path
        found.append(1 - float(graph.weight[chosen].sum()) / exact(graph).weight)
    gap = np.array(found)
    assert len(gap) >= 5
    assert gap.min() > -1e-9
    assert (gap < 1e-6).mean() >= (0.995 if warm is None else 0.8)
    assert gap.mean() <= (1e-4 if warm is None else 1e-2)


def test_the_best_cliques_combine_those_of_the_components() -> None:
    """Four components of leaves that exclude each other: the heaviest cliques against every choice of one leaf of each component."""
    rng = np.random.default_rng(4)
    tree = np.repeat(np.arange(4), 3)
    weight = rng.uniform(1, 5, len(tree))
    conflict = (tree[:, None] == tree[None, :]) & ~np.eye(len(tree), dtype=bool)
    search, nothing = HypothesisSearch(MhtParameters(k_h=6)), np.zeros(len(tree), dtype=bool)
    found = search.optima(Graph.from_conflicts(weight, np.argwhere(conflict)), np.arange(len(tree)), nothing, 0, {})
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
    leaves, conflict, none = mht.leaves, mht.conflict, np.zeros((0, len(mht.leaves)), dtype=bool)
    first = mht.search.solve(leaves, conflict, none, 0).best
    tree, count = np.unique(leaves.tree[leaves.score > 0], return_counts=True)
    fast = next(int(k) for k in first if leaves.tree[k] in tree[count > 1])
    state = leaves.state.copy()
    state[fast, 2:4] = 1.1 * mht.parameters.motion.v_max, 0.0
    then = mht.search.solve(replace(leaves, state=state), conflict, none, 0).best
    assert fast not in then
    assert leaves.tree[fast] in leaves.tree[then]
