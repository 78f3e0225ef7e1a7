"""The graph files of a run: each is read back, its clique is valid, and its gap to the proved optimum is small."""

from pathlib import Path

import numpy as np

from tracker.clique.branch_and_bound import exact
from tracker.datasets import synthetic_crowd
from tracker.formats.dimacs import read_graph
from tracker.mht.parameters import MhtParameters
from tracker.pipeline import Parameters, track


def test_graph_files_hold_cliques_near_the_optimum(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    setup, walked = synthetic_crowd.setup(), synthetic_crowd.paths(10, 12, rng)
    many = Parameters(targets=MhtParameters(graphs=tmp_path))
    list(track(setup, synthetic_crowd.ticks(setup, walked, rng, clutter=1.0), many))
    paths = sorted(tmp_path.glob("*.clq"))
    assert paths
    gaps = []
    for path in paths:
        graph = read_graph(path)
        chosen = np.array(path.with_suffix(".txt").read_text().split(), dtype=np.int64) - 1
        assert graph.is_clique(chosen)
        gaps.append(1 - graph.weight[chosen].sum() / exact(graph).weight)
    assert min(gaps) > -1e-9
    assert max(gaps) < 5e-3
    assert np.mean(np.array(gaps) < 1e-9) >= 0.8
