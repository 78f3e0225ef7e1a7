"""Weighted graphs in the DIMACS clique format: lines `p edge N M`, `n VERTEX WEIGHT`, `e A B`, `c COMMENT`; vertices count from 1."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tracker.clique.local_search import Graph
from tracker.io.atomic import write_text

MOST_VERTICES = 20_000
"""The adjacency matrix of this many vertices takes 400 MB."""


def read_graph(path: Path) -> Graph:
    """Read a graph; a vertex without an `n` line has weight 1.

    Raises ValueError with file and line for another kind of line, a wrong count, a self-loop, or a weight that is not above 0.
    Raises FileNotFoundError where the file does not exist.
    """
    weight: np.ndarray | None = None
    count = 0
    edges: list[tuple[int, int]] = []
    for number, line in enumerate(path.read_text(encoding="utf-8-sig", errors="replace").splitlines(), 1):
        words = line.split()
        if not words or words[0] == "c":
            continue
        try:
            if words[0] == "p" and weight is None and len(words) == 4:
                if not 1 <= int(words[2]) <= MOST_VERTICES:
                    raise ValueError(f"has {words[2]} vertices, needs 1 to {MOST_VERTICES}")
                weight, count = np.ones(int(words[2])), int(words[3])
            elif words[0] == "n" and weight is not None and len(words) == 3:
                vertex = _vertex(words[1], len(weight))
                weight[vertex] = float(words[2])
                if not 0 < weight[vertex] < np.inf:
                    raise ValueError(f"weight is {words[2]}, needs more than 0")
            elif words[0] == "e" and weight is not None and len(words) == 3:
                a, b = (_vertex(word, len(weight)) for word in words[1:3])
                if a == b:
                    raise ValueError(f"vertex {words[1]} has an edge to itself")
                edges.append((a, b))
            else:
                raise ValueError(f"{line!r} is none of `p edge N M` (first, once), `n VERTEX WEIGHT`, `e A B`, `c …`")
        except (ValueError, IndexError) as error:
            raise ValueError(f"{path}, line {number}: {error}") from None
    if weight is None:
        raise ValueError(f"{path}: has no line `p edge N M`")
    if len(edges) != count:
        raise ValueError(f"{path}: has {len(edges)} edges, its line `p` says {count}")
    return Graph.from_edges(weight, np.array(edges, dtype=np.int64).reshape(-1, 2))


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
    vertex = int(word)
    if not 1 <= vertex <= count:
        raise ValueError(f"vertex is {vertex}, needs 1 to {count}")
    return vertex - 1
