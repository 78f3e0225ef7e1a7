"""How near cliques are to the best, on graphs whose best is seen at a glance."""

from pathlib import Path

import numpy as np
import pytest

from sim.stress.bounds import gap
from tracker.clique.local_search import Graph
from tracker.mht.global_hypothesis import dump


def test_the_gap_is_the_share_of_weight_that_is_lost(tmp_path: Path) -> None:
    assert gap(tmp_path) is None
    # A triangle of conflicts and a vertex that goes with all: the best is 5 + 1.
    graph = Graph.from_conflicts(np.array([5.0, 4.0, 3.0, 1.0]), np.array([[0, 1], [0, 2], [1, 2]]))
    dump(tmp_path, "00000000-0", graph, np.array([0, 3]))
    assert gap(tmp_path) == 0.0
    # The same with 3 + 1: of 12 that could be had, 10 were.
    dump(tmp_path, "00000001-0", graph, np.array([2, 3]))
    assert gap(tmp_path) == pytest.approx(2 / 12)
