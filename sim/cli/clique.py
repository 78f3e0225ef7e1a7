"""The command `pilsim clique`: find a maximum-weight clique of a graph."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from sim.cli.options import json_text, unset
from tracker.options import Least


@dataclass(frozen=True)
class Clique:
    """Find a maximum-weight clique of a graph in the DIMACS format.

    The solver is breakout local search, or with --exact branch and bound. Vertices
    count from 1, as in the file.

    Example: pilsim clique C500.9.clq --seconds 10 --seed 1 --target 6955 --json
    """

    file: Annotated[Positional[Path], arg(metavar="FILE")]
    """The graph: lines `p edge N M`, `n VERTEX WEIGHT`, `e A B`. A vertex without a line has the weight 1."""
    seconds: float = 10.0
    """Time limit of the search or of the proof, s."""
    seed: Annotated[int, Least(0)] = 0
    """The seed of the search; the same seed makes the same moves."""
    target: Annotated[float | None, unset("WEIGHT", "none")] = None
    """The search stops at a clique of at least this weight."""
    exact: bool = False
    """Prove that the clique has the maximum weight; for small graphs."""
    json: bool = False
    """Print JSON alone: weight, moves, seconds, clique."""

    def run(self) -> None:
        from tracker.clique.dimacs import read_graph
        from tracker.clique.exact_clique import exact
        from tracker.clique.local_search import Limits, search

        graph = read_graph(self.file)
        search(graph, Limits(moves=1))  # Compilation must not count as search time.
        found = exact(graph, self.seconds) if self.exact else search(graph, Limits(seconds=self.seconds, target=self.target), self.seed)
        clique = [int(v) + 1 for v in found.vertices]
        if not math.isfinite(found.weight):
            raise ValueError(f"{self.file}: the weights of a clique add up to {found.weight}, needs a finite sum")
        if self.json:
            print(json_text({"weight": found.weight, "moves": found.moves, "seconds": round(found.seconds, 6), "clique": clique}))
        else:
            kind = "the heaviest clique" if self.exact else "a clique"
            print(f"{kind} of weight {found.weight:g}, {len(clique)} of {len(graph)} vertices, after {found.moves} moves in {found.seconds:.3f} s")
            print(*clique)
