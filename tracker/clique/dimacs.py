"""Weighted graphs in the DIMACS clique format: lines `p edge N M`, `n VERTEX WEIGHT`, `e A B`, `c COMMENT`; vertices count from 1."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tracker.clique.local_search import Graph
from tracker.geometry import Array, Ints
from tracker.io.atomic import write_text
from tracker.io.text_files import parse_integer, parse_number, read_lines, shown

MOST_VERTICES = 20_000
"""The adjacency matrix of this many vertices takes 400 MB."""
MOST_CONFLICTS = 1 << 25
"""Graph stores the pairs without an edge, each twice, 8 bytes each."""


def read_graph(path: Path) -> Graph:
    """Read a graph; a vertex without an `n` line has weight 1.

    Raises ValueError with file and line for another kind of line, a wrong count, a self-loop, or a weight that is not above 0.
    Raises FileNotFoundError where the file does not exist.
    """
    weight: Array | None = None
    count = 0
    edges: list[tuple[int, int]] = []
    for number, line in read_lines(path, errors="replace"):
        words = line.split()
        if words[0] == "c":
            continue
        try:
            if words[0] == "p" and weight is None and len(words) == 4:
                vertices, count = parse_integer(words[2], "number of vertices"), parse_integer(words[3], "number of edges")
                if not 1 <= vertices <= MOST_VERTICES:
                    raise ValueError(f"has {vertices} vertices, needs 1 to {MOST_VERTICES}")
                weight = np.ones(vertices)
            elif words[0] == "n" and weight is not None and len(words) == 3:
                vertex = _vertex(words[1], len(weight))
                weight[vertex] = parse_number(words[2], "weight")
                if not weight[vertex] > 0:
                    raise ValueError(f"weight is {words[2]}, needs more than 0")
            elif words[0] == "e" and weight is not None and len(words) == 3:
                a, b = (_vertex(word, len(weight)) for word in words[1:3])
                if a == b:
                    raise ValueError(f"vertex {words[1]} has an edge to itself")
                edges.append((a, b))
            else:
                raise ValueError(f"{shown(line)} is none of `p edge N M` (first, once), `n VERTEX WEIGHT`, `e A B`, `c …`")
        except (ValueError, IndexError) as error:
            raise ValueError(f"{path}, line {number}: {error}") from None
    if weight is None:
        raise ValueError(f"{path}: has no line `p edge N M`")
    if len(edges) != count:
        raise ValueError(f"{path}: has {len(edges)} edges, its line `p` says {count}")
    return _graph(path, weight, np.array(edges, dtype=np.int64).reshape(-1, 2))


def _graph(path: Path, weight: Array, edges: Ints) -> Graph:
    """The graph of weight (n,) and edges (m, 2) of compatible vertices, with a bound on its memory."""
    apart = np.ones((len(weight), len(weight)), dtype=np.bool_)
    np.fill_diagonal(apart, False)
    apart[edges[:, 0], edges[:, 1]] = apart[edges[:, 1], edges[:, 0]] = False
    degree = np.count_nonzero(apart, axis=1)
    if degree.sum() > MOST_CONFLICTS:
        raise ValueError(f"{path}: {degree.sum() // 2} pairs of its {len(weight)} vertices have no edge, needs at most {MOST_CONFLICTS // 2}")
    column = np.flatnonzero(apart)
    column %= len(weight)
    return Graph.from_rows(weight, degree, column)


def write_graph(path: Path, graph: Graph) -> None:
    """Write a graph atomically; read_graph reads it back."""
    n = len(graph)
    adjacent = ~np.eye(n, dtype=bool)
    adjacent[np.repeat(np.arange(n), np.diff(graph.start)), graph.conflict] = False
    adjacent = np.triu(adjacent)
    # Rows are joined at once for speed: a tracker writes thousands of graphs of 100 000 edges.
    names = np.array([str(v + 1) for v in range(n)], dtype=object)
    edges = []
    for v in np.flatnonzero(adjacent.any(axis=1)).tolist():
        row = f"e {v + 1} "
        edges.append(row + f"\n{row}".join(names[adjacent[v]]))
    lines = [f"p edge {n} {np.count_nonzero(adjacent)}", *(f"n {v + 1} {w!r}" for v, w in enumerate(graph.weight.tolist())), *edges]
    write_text(path, "\n".join(lines) + "\n")


def _vertex(word: str, count: int) -> int:
    vertex = parse_integer(word, "vertex")
    if not 1 <= vertex <= count:
        raise ValueError(f"vertex is {vertex}, needs 1 to {count}")
    return vertex - 1
