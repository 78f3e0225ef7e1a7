"""Weighted graphs in the DIMACS format: round trips and errors."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from tests.commands import pilsim
from tracker.clique.dimacs import read_graph, write_graph
from tracker.clique.local_search import Graph

PATH = "c a path of three\np edge 3 2\nn 1 4\nn 3 0.5\ne 1 2\ne 2 3\n"


def test_small_graph(tmp_path: Path) -> None:
    (tmp_path / "path.clq").write_text(PATH)
    graph = read_graph(tmp_path / "path.clq")
    assert graph.weight.tolist() == [4.0, 1.0, 0.5]
    assert graph.edges == 2
    assert graph.is_clique([0, 1])
    assert not graph.is_clique([0, 2])


def test_round_trip(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    graph = Graph.from_conflicts(rng.uniform(0.1, 3, 20), np.argwhere(np.triu(rng.random((20, 20)) < 0.4, 1)))
    write_graph(tmp_path / "g.clq", graph)
    again = read_graph(tmp_path / "g.clq")
    np.testing.assert_array_equal(again.weight, graph.weight)
    np.testing.assert_array_equal(again.conflict, graph.conflict)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("e 1 2\n", "line 1"),
        ("p edge 2 1\ne 1 1\n", "line 2: vertex 1 has an edge to itself"),
        ("p edge 2 1\nn 1 0\n", "line 2: weight is 0, needs more than 0"),
        ("p edge 2 1\nn 1 -3\n", "line 2: weight is -3"),
        ("p edge 2 1\ne 1 3\n", "line 2: vertex is 3, needs 1 to 2"),
        ("p edge 2 1\ne 1\n", "line 2"),
        ("p edge x 1\n", "line 1"),
        ("p edge\n", "line 1: 'p edge' is none of `p edge N M`"),
        ("p edge 1000000 0\n", "line 1: has 1000000 vertices, needs 1 to 20000"),
        ("p edge 0 0\n", "line 1: has 0 vertices"),
        ("p edge 3 2\ne 1 2\n", "has 1 edges, its line `p` says 2"),
        ("c nothing\n", "has no line"),
    ],
)
def test_errors_name_file_and_line(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "bad.clq").write_text(text)
    with pytest.raises(ValueError, match=message):
        read_graph(tmp_path / "bad.clq")


@pytest.mark.command
def test_command(tmp_path: Path) -> None:
    (tmp_path / "path.clq").write_text(PATH)
    command = ("clique", tmp_path / "path.clq", "--seconds", "0.1", "--json")
    done = pilsim(*command)
    assert done.returncode == 0, done.stderr
    answer = json.loads(done.stdout)
    assert (answer["weight"], answer["clique"]) == (5.0, [1, 2])
    assert json.loads(pilsim(*command, "--exact").stdout)["weight"] == 5.0
    missing = pilsim("clique", tmp_path / "none.clq")
    assert (missing.returncode, len(missing.stderr.strip().splitlines())) == (2, 1)
