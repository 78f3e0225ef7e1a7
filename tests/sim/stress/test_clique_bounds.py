"""The gap of the clique search, on small graphs with a known optimum."""

from pathlib import Path

import numpy as np
import pytest

from sim.stress.bounds import clique_gap
from tracker.clique.local_search import Graph
from tracker.mht.global_hypothesis import dump


def test_the_gap_is_the_share_of_weight_that_cliques_lack(tmp_path: Path) -> None:
    assert clique_gap(tmp_path) is None
    # Three vertices in conflict, and one that is compatible with all: the optimum is 5 + 1.
    graph = Graph.from_conflicts(np.array([5.0, 4.0, 3.0, 1.0]), np.array([[0, 1], [0, 2], [1, 2]]))
    dump(tmp_path, "00000000-0", graph, np.array([0, 3]))
    assert clique_gap(tmp_path) == 0.0
    # The second clique weighs 3 + 1, which makes 10 of 12.
    dump(tmp_path, "00000001-0", graph, np.array([2, 3]))
    assert clique_gap(tmp_path) == pytest.approx(2 / 12)
