"""The graphs of a run, written down: each comes back, its clique is one, and our proof says how near to the heaviest."""

from pathlib import Path

import numpy as np

from tests.tracker import crowds
from tracker.exact_clique import exact
from tracker.formats.dimacs import read_graph
from tracker.pipeline import Parameters, track
from tracker.selection import MultipleParameters


def test_the_graphs_of_a_run_and_how_well_they_are_solved(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    setup, walked = crowds.setup(), crowds.paths(10, 12, rng)
    many = Parameters(multiple=MultipleParameters(graphs=tmp_path))
    list(track(setup, crowds.ticks(setup, walked, rng, clutter=1.0), many))
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
