"""The best set of tracks: what was chosen in every graph of a run is beside its proved optimum."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tracker import crowds
from tracker.exact_clique import exact
from tracker.formats.dimacs import read_graph
from tracker.pipeline import Parameters, track
from tracker.selection import MultipleParameters


def gaps(folder: Path, many: MultipleParameters) -> np.ndarray:
    """The share of the best weight that is missing in each graph of a run on a crowd with false boxes."""
    rng = np.random.default_rng(3)
    setup, walked = crowds.setup(), crowds.paths(8, 15, rng)
    list(track(setup, crowds.ticks(setup, walked, rng, clutter=0.2), Parameters(multiple=many)))
    out = []
    for path in sorted(folder.glob("*.clq")):
        graph = read_graph(path)
        chosen = np.array(path.with_suffix(".txt").read_text().split(), dtype=np.int64) - 1
        assert graph.is_clique(chosen), path
        out.append(1 - float(graph.weight[chosen].sum()) / exact(graph).weight)
    return np.array(out)


@pytest.mark.parametrize("small", [False, True])
@pytest.mark.parametrize("warm", [False, True])
def test_what_is_chosen_is_the_best_there_is(tmp_path: Path, small: bool, warm: bool) -> None:
    gap = gaps(tmp_path, MultipleParameters(small_graphs=small, warm=warm, k_h=3, graphs=tmp_path))
    assert len(gap) >= 5
    assert (gap < 1e-6).mean() >= 0.995
    assert gap.mean() <= 1e-4
