"""The graphs that a run of the tracker by multiple hypotheses solves, written down: so that another solver can be asked, too."""

from __future__ import annotations

from pathlib import Path

from tracker.clique import Graph
from tracker.formats.dimacs import write_graph
from tracker.measurements import Ints


def dump(folder: Path, name: str, graph: Graph, chosen: Ints) -> None:
    """Write `graph` as folder/NAME.clq (DIMACS, weighted) and the clique that was chosen, vertices from 1 in a row, as folder/NAME.txt."""
    folder.mkdir(parents=True, exist_ok=True)
    write_graph(folder / f"{name}.clq", graph)
    (folder / f"{name}.txt").write_text(" ".join(str(v + 1) for v in chosen.tolist()) + "\n", encoding="utf-8")
