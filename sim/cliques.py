"""How near the tracker's cliques are to the best: graphs that it solved, solved again with proof."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tracker.exact_clique import exact
from tracker.formats.dimacs import read_graph

SOLVED = 100
"""Graphs of a run that are solved again at most, evenly spread over it."""
LARGEST = 400
"""Vertices of a graph that is; larger ones may take the proof long."""
PATIENCE = 60.0
"""s for a proof. So few vertices take milliseconds: a run without a proof is a rare one, and its graph counts for nothing."""


def gap(folder: Path, most: int = SOLVED) -> float | None:
    """By what share the cliques that were chosen weigh less than the heaviest ones, in all, over graphs that tracker.dumping wrote; None for none.

    most: graphs that are solved again, at most, evenly spread over the run.
    """
    paths = [path for path in sorted(folder.glob("*.clq")) if _vertices(path) <= LARGEST]
    chosen = best = 0.0
    for k in np.unique(np.linspace(0, len(paths) - 1, min(most, len(paths))).round().astype(int)).tolist():
        graph = read_graph(paths[k])
        vertices = [int(word) - 1 for word in paths[k].with_suffix(".txt").read_text(encoding="utf-8").split()]
        try:
            heaviest = exact(graph, PATIENCE).weight
        except ValueError:
            continue
        chosen, best = chosen + float(graph.weight[vertices].sum()), best + heaviest
    # Two sums of the same weights may differ in their last bits.
    return max(0.0, round(1.0 - chosen / best, 12)) if best > 0 else None


def _vertices(path: Path) -> int:
    with path.open(encoding="utf-8") as file:
        return next((int(line.split()[2]) for line in file if line.startswith("p ")), 0)
